//! What a residual goes with: tests for structure, each against the same machine without effect.

use std::f64::consts::{PI, TAU};
use std::fmt;

use rayon::prelude::*;
use serde::Serialize;

use super::bins::{Bins, Place, binned, known, takes};
use super::null::Draws;
use super::observed::{Abscissa, Observed, common};
use super::select::Selection;
use super::statistics::{gumbel, mean};
use loadtwin_math::metrics::Autocorrelation;

/// Chance that any test of any residual of a clean machine stands out.
const FALSE_ALARM: f64 = 0.01;

/// Orders of each shaft that are looked at.
const ORDERS: usize = 12;

/// Periods of an order from which on it is told from a drift.
const PERIODS: f64 = 4.0;

/// How a residual is tested.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Test {
    /// Mean over its standard error, from the means of blocks.
    Bias,
    /// Root mean square of the autocorrelation over lags of 1 to 25 samples; `1/sqrt(n)` for
    /// white noise.
    Colour,
    /// Part of the mean square over a shaft's angle `phi` in its order `o`: that of the
    /// `a cos(o phi) + b sin(o phi)` that is nearest to the residual about its mean.
    Order,
    /// Part of the mean square about the mean that the mean over a quantity takes from blocks
    /// left out, of any form and either sign; over time it is a drift.
    Over,
    /// Correlation with another residual: near -1 where two gauges err against each other.
    Beside,
}

impl Test {
    /// What counts as something, whatever the draws say.
    fn least(self) -> f64 {
        match self {
            Self::Bias => 4.0,
            Self::Colour | Self::Order | Self::Over => 0.02,
            Self::Beside => 0.1,
        }
    }

    /// Largest size that it can have; none where it has no bound.
    fn most(self) -> Option<f64> {
        match self {
            Self::Bias => None,
            Self::Colour | Self::Order | Self::Over | Self::Beside => Some(1.0),
        }
    }
}

/// One test of one residual.
#[derive(Clone, Debug, Serialize)]
pub struct Tested {
    /// How it was tested.
    pub test: Test,
    /// The quantity, order or other residual; empty where there is none.
    pub with: String,
    /// What it says of the residual.
    pub before: f64,
    /// The same with what was found.
    pub after: f64,
    /// Size that a machine without effect hardly exceeds; none where it reaches any size.
    pub by_chance: Option<f64>,
}

impl Tested {
    /// Whether the residual is unlike that of a machine without effect.
    pub fn stands_out(&self) -> bool {
        self.by_chance
            .is_some_and(|by_chance| self.before.abs() > by_chance)
    }
}

impl fmt::Display for Tested {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let with = &self.with;
        match self.test {
            Test::Bias => write!(f, "mean [its standard errors]"),
            Test::Colour => write!(f, "autocorrelation"),
            Test::Order => write!(f, "order {with}"),
            Test::Over => write!(f, "{}", with.to_lowercase()),
            Test::Beside => write!(f, "{with} (correlation)"),
        }
    }
}

/// The tests of one residual.
#[derive(Clone, Debug, Serialize)]
pub struct Structure {
    /// The residual.
    pub channel: String,
    /// The tests.
    pub tests: Vec<Tested>,
}

impl Structure {
    /// The tests that tell it from a machine without effect, the clearest first.
    pub fn standing_out(&self) -> Vec<&Tested> {
        let clear =
            |t: &'_ Tested| Some(t.before.abs() / t.by_chance?).filter(|times| *times > 1.0);
        let mut out: Vec<(&Tested, f64)> = (self.tests.iter())
            .filter_map(|t| Some((t, clear(t)?)))
            .collect();
        out.sort_by(|a, b| b.1.total_cmp(&a.1));
        out.into_iter().map(|(tested, _)| tested).collect()
    }
}

/// Residuals, `[session][stream]`.
type Residuals = Vec<Vec<Vec<f64>>>;

/// What each residual goes with, before and after what was found, in the order of the streams.
///
/// What a clean machine leaves is no part of it.
pub fn structures<S: Observed>(
    sessions: &[S],
    selection: &Selection<S>,
    draws: &Draws,
) -> Vec<Structure> {
    let streams = sessions[0].streams().len();
    let measured: Residuals = (sessions.iter())
        .map(|s| (0..streams).map(|k| s.residual(k).to_vec()).collect())
        .collect();
    let before = beside_clean(sessions, &measured);
    let draws: Vec<Residuals> = (draws.par_iter())
        .map(|draw| beside_clean(sessions, draw))
        .collect();
    let shafts: Vec<Turning> = (0..sessions[0].shafts().len())
        .map(|number| Turning::of(sessions, number))
        .collect();
    let quantities = common(sessions);
    (0..streams)
        .into_par_iter()
        .map(|k| {
            let measures = measures(sessions, k, &shafts, &quantities, &before);
            let chance = FALSE_ALARM / (streams * measures.len()) as f64;
            Structure {
                channel: sessions[0].name(k).to_owned(),
                tests: (measures.iter())
                    .filter_map(|m| m.tested(&before, &selection.rest, &draws, chance))
                    .collect(),
            }
        })
        .collect()
}

/// `residuals` less what a clean machine leaves, where they were measured.
fn beside_clean<S: Observed>(sessions: &[S], residuals: &Residuals) -> Residuals {
    let stream = |session: &S, k: usize, values: &Vec<f64>| -> Vec<f64> {
        let clean = session
            .clean(k)
            .iter()
            .copied()
            .chain(std::iter::repeat(0.0));
        (values.iter().zip(session.residual(k)).zip(clean))
            .map(|((v, r), clean)| if r.is_finite() { v - clean } else { f64::NAN })
            .collect()
    };
    (sessions.iter().zip(residuals))
        .map(|(s, of)| {
            of.iter()
                .enumerate()
                .map(|(k, v)| stream(s, k, v))
                .collect()
        })
        .collect()
}

/// What a test says of residuals, for each thing that they may go with.
type Values<'a> = dyn Fn(&Residuals) -> Vec<f64> + 'a;

/// What a test measures, with each thing that a residual may go with.
struct Measure<'a> {
    test: Test,
    with: Vec<String>,
    of: Box<Values<'a>>,
}

impl<'a> Measure<'a> {
    fn alone(test: Test, with: &str, of: impl Fn(&Residuals) -> f64 + 'a) -> Self {
        Self {
            test,
            with: vec![with.to_owned()],
            of: Box::new(move |residuals| vec![of(residuals)]),
        }
    }

    /// Of what `before` goes with most; none where there is nothing to go with.
    fn tested(
        &self,
        before: &Residuals,
        after: &Residuals,
        draws: &[Residuals],
        chance: f64,
    ) -> Option<Tested> {
        let size = |v: &f64| if v.is_finite() { v.abs() } else { 0.0 };
        let most = |values: &[f64]| values.iter().map(size).fold(0.0, f64::max);
        let all = (self.of)(before);
        let best = (0..all.len()).max_by(|a, b| size(&all[*a]).total_cmp(&size(&all[*b])))?;
        let clean: Vec<f64> = draws.iter().map(|draw| most(&(self.of)(draw))).collect();
        let by_chance = gumbel(&clean, chance).max(self.test.least());
        Some(Tested {
            test: self.test,
            with: self.with[best].clone(),
            before: all[best],
            after: (self.of)(after)[best],
            by_chance: (self.test.most().is_none_or(|most| by_chance < most)).then_some(by_chance),
        })
    }
}

/// The tests of stream `k`.
fn measures<'a, S: Observed>(
    sessions: &'a [S],
    k: usize,
    shafts: &'a [Turning],
    quantities: &'a [Vec<Abscissa<'a>>],
    before: &Residuals,
) -> Vec<Measure<'a>> {
    let mut all = vec![
        Measure::alone(Test::Bias, "", move |r| bias(sessions, r, k)),
        Measure::alone(Test::Colour, "", move |r| colour(r, k)),
    ];
    for shaft in shafts {
        let of = |o: &usize| format!("{o} of {}", shaft.name);
        all.push(Measure {
            test: Test::Order,
            with: shaft.orders.iter().map(of).collect(),
            of: Box::new(move |r| {
                let parts = orders_of(&shaft.waves, r, k);
                shaft.orders.iter().map(|o| parts[o - 1]).collect()
            }),
        });
    }
    for along in quantities {
        let values = along.iter().zip(before);
        let values = values.flat_map(|(along, r)| known(&along.values, &r[k]));
        if let Some(bins) = Bins::of(values) {
            // Looked up once, and not again in each draw.
            let places: Vec<Vec<Option<Place>>> = (sessions.iter().zip(along))
                .map(|(s, along)| bins.places(&along.values, s.block()))
                .collect();
            let takes = move |r: &Residuals| {
                let samples = places.iter().zip(r).flat_map(|(at, r)| binned(at, &r[k]));
                takes(&samples.collect::<Vec<_>>()).max(0.0)
            };
            all.push(Measure::alone(Test::Over, along[0].quantity, takes));
        }
    }
    let others: Vec<usize> = (0..before[0].len()).filter(|j| *j != k).collect();
    all.push(Measure {
        test: Test::Beside,
        with: others
            .iter()
            .map(|j| sessions[0].name(*j).to_owned())
            .collect(),
        of: Box::new(move |r| others.iter().map(|j| correlation(r, k, *j)).collect()),
    });
    all
}

fn bias<S: Observed>(sessions: &[S], residuals: &Residuals, k: usize) -> f64 {
    let means: Vec<f64> = (sessions.iter().zip(residuals))
        .flat_map(|(s, r)| r[k].chunks(s.block()))
        .map(|block| mean(block.iter().copied()))
        .filter(|m| m.is_finite())
        .collect();
    let middle = mean(means.iter().copied());
    let variance = mean(means.iter().map(|m| (m - middle).powi(2)));
    middle / (variance / (means.len() as f64 - 1.0)).sqrt()
}

fn colour(residuals: &Residuals, k: usize) -> f64 {
    let mut sequence = Autocorrelation::default();
    residuals
        .iter()
        .flat_map(|r| &r[k])
        .for_each(|v| sequence.push(*v));
    let squares = sequence.coefficients().into_iter().flatten().map(|r| r * r);
    mean(squares).sqrt()
}

/// `cos phi`, `sin phi` and the step of `phi` for each sample of a shaft, `[session][sample]`.
type Waves = Vec<Vec<[f64; 3]>>;

fn wave(angle: &[f64]) -> Vec<[f64; 3]> {
    let next = angle.iter().skip(1).chain(angle.last());
    (angle.iter().zip(next))
        .map(|(a, next)| [a.cos(), a.sin(), (next - a).abs()])
        .collect()
}

/// A shaft as it turned in the sessions.
struct Turning {
    name: String,
    /// Orders that turn often enough to be told from a drift and are slow enough for the sampling.
    orders: Vec<usize>,
    waves: Waves,
}

impl Turning {
    /// Shaft `number` of `sessions`.
    fn of<S: Observed>(sessions: &[S], number: usize) -> Self {
        let waves: Waves = (sessions.iter())
            .map(|session| wave(&session.shafts()[number].angle))
            .collect();
        let steps = || waves.iter().flatten().map(|w| w[2]).filter(|w| *w > 0.0);
        let (turned, samples): (f64, f64) = (steps().sum(), steps().count() as f64);
        let orders = (1..=ORDERS)
            .filter(|o| *o as f64 * turned >= PERIODS * TAU)
            .filter(|o| *o as f64 * turned <= 0.8 * PI * samples)
            .collect();
        Self {
            name: sessions[0].shafts()[number].name.to_owned(),
            orders,
            waves,
        }
    }
}

/// The part of stream `k` in each order, from the first; over the angle, so that a standstill
/// tells nothing. A session in which an order does not turn `PERIODS` times has no part in it.
fn orders_of(waves: &Waves, residuals: &Residuals, k: usize) -> [f64; ORDERS] {
    let (mut parts, mut square) = ([0.0; ORDERS], 0.0);
    let turn = |[re, im]: [f64; 2], c: f64, s: f64| [re * c - im * s, re * s + im * c];
    for (waves, residuals) in waves.iter().zip(residuals) {
        let known = || {
            let weighed = waves.iter().zip(&residuals[k]);
            weighed.filter(|([.., step], r)| step.is_finite() && r.is_finite())
        };
        let turned: f64 = known().map(|(w, _)| w[2]).sum();
        let middle = known().map(|(w, r)| w[2] * r).sum::<f64>() / turned;
        // Of the residual, and of 1 at twice the order.
        let mut sums = [[0.0; 4]; ORDERS];
        for ([c, s, step], r) in known() {
            let r = r - middle;
            square += step * r * r;
            let (mut wave, mut twice) = ([step * r, 0.0], [*step, 0.0]);
            for sum in &mut sums {
                wave = turn(wave, *c, *s);
                twice = turn(turn(twice, *c, *s), *c, *s);
                for (sum, new) in sum.iter_mut().zip(wave.into_iter().chain(twice)) {
                    *sum += new;
                }
            }
        }
        for (o, (part, sums)) in parts.iter_mut().zip(sums).enumerate() {
            if (o + 1) as f64 * turned >= PERIODS * TAU {
                *part += explained_by_wave(turned, sums);
            }
        }
    }
    parts.map(|part| part / square)
}

/// Squares that `a cos + b sin` explains, by least squares: `v' G^-1 v` with
/// `v = (sum r cos, sum r sin)` and `G` of the sums of `cos^2`, `cos sin` and `sin^2`, from those of
/// the cosine and sine of twice the angle.
fn explained_by_wave(turned: f64, [cos, sin, cos_of_twice, sin_of_twice]: [f64; 4]) -> f64 {
    let (cc, ss) = (0.5 * (turned + cos_of_twice), 0.5 * (turned - cos_of_twice));
    let cs = 0.5 * sin_of_twice;
    (ss * cos * cos - 2.0 * cs * cos * sin + cc * sin * sin) / (cc * ss - cs * cs)
}

fn correlation(residuals: &Residuals, k: usize, j: usize) -> f64 {
    let pairs = || {
        (residuals.iter())
            .flat_map(|r| r[k].iter().zip(&r[j]))
            .filter(|(a, b)| a.is_finite() && b.is_finite())
    };
    let (a, b) = (mean(pairs().map(|p| *p.0)), mean(pairs().map(|p| *p.1)));
    let (mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0);
    for (x, y) in pairs() {
        aa += (x - a).powi(2);
        bb += (y - b).powi(2);
        ab += (x - a) * (y - b);
    }
    ab / f64::sqrt(aa * bb)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// White noise of variance 1/12, the same for the same seed.
    fn noise(seed: u32) -> impl FnMut() -> f64 {
        let mut state = seed;
        move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state) / f64::from(u32::MAX) - 0.5
        }
    }

    fn residuals(streams: &[&dyn Fn(f64) -> f64]) -> Residuals {
        let mut white = noise(1);
        let stream =
            |of: &&dyn Fn(f64) -> f64| (0..20_000).map(|i| of(f64::from(i)) + white()).collect();
        vec![streams.iter().map(stream).collect()]
    }

    #[test]
    fn an_order_has_the_part_that_its_amplitude_says() {
        // Not a whole number of turns, and a standstill in between.
        let angle = |i: f64| 0.013 * (i.min(9_000.0) + (i - 12_000.0).max(0.0));
        let angles: Vec<f64> = (0..20_000).map(|i| angle(f64::from(i))).collect();
        let waves = vec![wave(&angles)];
        let of = residuals(&[&|i| 0.4 * (3.0 * angle(i) + 1.0).cos() + 5.0]);
        let parts = orders_of(&waves, &of, 0);
        let expected = 0.08 / (0.08 + 1.0 / 12.0);
        assert!((parts[2] - expected).abs() < 0.02, "{parts:?} {expected}");
        assert!(
            parts.iter().enumerate().all(|(o, p)| o == 2 || *p < 0.02),
            "{parts:?}"
        );
    }

    /// Turns that are no whole number of periods: of a wave alone the part is all of it, no more.
    #[test]
    fn a_part_is_at_most_one() {
        let angles: Vec<f64> = (0..2_000).map(|i| 0.0159 * f64::from(i)).collect();
        let waves = vec![wave(&angles)];
        for phase in [0.0, 0.8, 1.6, 2.4] {
            let of: Vec<f64> = angles.iter().map(|a| (a + phase).cos()).collect();
            let part = orders_of(&waves, &vec![vec![of]], 0)[0];
            assert!((0.99..=1.0 + 1e-12).contains(&part), "{phase}: {part}");
        }
    }

    #[test]
    fn gauges_that_err_against_each_other_are_anticorrelated() {
        let wave = |i: f64| (0.02 * i).sin();
        let both = residuals(&[&wave, &|i| 1.0 - wave(i), &|_| 0.0]);
        // 1/2 of signal, 1/12 of noise.
        assert!((correlation(&both, 0, 1) + 6.0 / 7.0).abs() < 0.02);
        assert!(correlation(&both, 0, 2).abs() < 0.05);
    }

    #[test]
    fn colour_tells_a_wave_from_white_noise() {
        let of = residuals(&[&|_| 3.0, &|i| (0.02 * i).sin()]);
        assert!(colour(&of, 0) < 0.01, "{}", colour(&of, 0));
        assert!(colour(&of, 1) > 0.7, "{}", colour(&of, 1));
    }
}
