//! Tests each residual before and after the effects found: for bias, autocorrelation, shaft orders
//! 1 to 12, dependence on covariates and cross-correlation. The thresholds are quantiles of the
//! null samples, so that 1 % of fault-free machines have any significant test.

use std::f64::consts::{PI, TAU};
use std::fmt;

use rayon::prelude::*;
use serde::Serialize;

use crate::assessment::binned_mean::{BinRange, Bins, binned, explained_by_bins, known};
use crate::null_samples::NullSamples;
use crate::residual_model::{Covariate, ResidualModel, common_covariates};
use crate::sample_statistics::{gumbel_quantile, mean};
use crate::selection::stepwise::Selection;
use loadtwin_math::metrics::Autocorrelation;

/// Probability that any test of any residual of a fault-free machine is significant.
const FALSE_ALARM: f64 = 0.01;

/// Orders of each shaft that are looked at.
const ORDERS: usize = 12;

/// Periods of an order that distinguish it from a drift.
const PERIODS: f64 = 4.0;

/// How a residual is tested.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Test {
    /// Mean over its standard error, from the means of blocks.
    Bias,
    /// Root mean square of the autocorrelation over lags of 1 to 25 samples; `1/sqrt(n)` for
    /// white noise.
    #[serde(rename = "colour")]
    Autocorrelation,
    /// Part of the mean square over a shaft's angle `phi` in its order `o`: that of the
    /// `a cos(o phi) + b sin(o phi)` that is nearest to the residual about its mean.
    Order,
    /// Part of the mean square about the mean that the mean over a quantity explains in hold-out
    /// blocks, for any function and either sign; over time it is a drift.
    #[serde(rename = "over")]
    Covariate,
    /// Correlation with another residual: near -1 where two gauges err against each other.
    #[serde(rename = "beside")]
    CrossCorrelation,
}

impl Test {
    /// Smallest threshold, whatever the null samples.
    fn least(self) -> f64 {
        match self {
            Self::Bias => 4.0,
            Self::Autocorrelation | Self::Order | Self::Covariate => 0.02,
            Self::CrossCorrelation => 0.1,
        }
    }

    /// Largest size that it can have; none where it has no bound.
    fn most(self) -> Option<f64> {
        match self {
            Self::Bias => None,
            Self::Autocorrelation | Self::Order | Self::Covariate | Self::CrossCorrelation => {
                Some(1.0)
            }
        }
    }
}

/// One test of one residual.
#[derive(Clone, Debug, Serialize)]
pub struct TestResult {
    /// How it was tested.
    pub test: Test,
    /// The quantity, order or other residual; empty where there is none.
    pub with: String,
    /// Its statistic for the residual.
    pub before: f64,
    /// The same after the effects found.
    pub after: f64,
    /// Size that a machine without effect hardly exceeds; none where it reaches any size.
    pub by_chance: Option<f64>,
}

impl TestResult {
    /// Whether the residual is unlike that of a machine without effect.
    pub fn is_significant(&self) -> bool {
        self.by_chance
            .is_some_and(|by_chance| self.before.abs() > by_chance)
    }
}

impl fmt::Display for TestResult {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let with = &self.with;
        match self.test {
            Test::Bias => write!(f, "mean [its standard errors]"),
            Test::Autocorrelation => write!(f, "autocorrelation"),
            Test::Order => write!(f, "order {with}"),
            Test::Covariate => write!(f, "{}", with.to_lowercase()),
            Test::CrossCorrelation => write!(f, "{with} (correlation)"),
        }
    }
}

/// The tests of one residual.
#[derive(Clone, Debug, Serialize)]
pub struct ResidualTests {
    /// The residual.
    pub channel: String,
    /// The tests.
    pub tests: Vec<TestResult>,
}

impl ResidualTests {
    /// The tests that reject a machine without effect, the most significant first.
    pub fn significant(&self) -> Vec<&TestResult> {
        let clear =
            |t: &'_ TestResult| Some(t.before.abs() / t.by_chance?).filter(|times| *times > 1.0);
        let mut out: Vec<(&TestResult, f64)> = (self.tests.iter())
            .filter_map(|t| Some((t, clear(t)?)))
            .collect();
        out.sort_by(|a, b| b.1.total_cmp(&a.1));
        out.into_iter().map(|(tested, _)| tested).collect()
    }
}

/// Residuals, `[recording][signal]`.
type ResidualSet = Vec<Vec<Vec<f64>>>;

/// All tests of each residual before and after the effects found, in the order of the signals.
///
/// The residual of a fault-free machine is subtracted.
pub fn residual_tests<S: ResidualModel>(
    recordings: &[S],
    selection: &Selection<S>,
    null_samples: &NullSamples,
) -> Vec<ResidualTests> {
    let signals = recordings[0].residuals().len();
    let measured: ResidualSet = (recordings.iter())
        .map(|s| (0..signals).map(|k| s.residual(k).to_vec()).collect())
        .collect();
    let before = against_null(recordings, &measured);
    let null_samples: Vec<ResidualSet> = (null_samples.par_iter())
        .map(|null_sample| against_null(recordings, null_sample))
        .collect();
    let shafts: Vec<Turning> = (0..recordings[0].shafts().len())
        .map(|number| Turning::of(recordings, number))
        .collect();
    let quantities = common_covariates(recordings);
    (0..signals)
        .into_par_iter()
        .map(|k| {
            let measures = measures(recordings, k, &shafts, &quantities, &before);
            let chance = FALSE_ALARM / (signals * measures.len()) as f64;
            ResidualTests {
                channel: recordings[0].name(k).to_owned(),
                tests: (measures.iter())
                    .filter_map(|m| {
                        m.tested(&before, &selection.residuals_after, &null_samples, chance)
                    })
                    .collect(),
            }
        })
        .collect()
}

/// `residuals` less those of a fault-free machine, where they were measured.
fn against_null<S: ResidualModel>(recordings: &[S], residuals: &ResidualSet) -> ResidualSet {
    let signal = |recording: &S, k: usize, values: &Vec<f64>| -> Vec<f64> {
        let fault_free = recording
            .fault_free(k)
            .iter()
            .copied()
            .chain(std::iter::repeat(0.0));
        (values.iter().zip(recording.residual(k)).zip(fault_free))
            .map(|((v, r), fault_free)| {
                if r.is_finite() {
                    v - fault_free
                } else {
                    f64::NAN
                }
            })
            .collect()
    };
    (recordings.iter().zip(residuals))
        .map(|(s, of)| {
            of.iter()
                .enumerate()
                .map(|(k, v)| signal(s, k, v))
                .collect()
        })
        .collect()
}

/// Statistic of a test on residuals, for each quantity that they may correlate with.
type Values<'a> = dyn Fn(&ResidualSet) -> Vec<f64> + 'a;

/// What a test measures, with each thing that a residual may go with.
struct Measure<'a> {
    test: Test,
    with: Vec<String>,
    of: Box<Values<'a>>,
}

impl<'a> Measure<'a> {
    fn alone(test: Test, with: &str, of: impl Fn(&ResidualSet) -> f64 + 'a) -> Self {
        Self {
            test,
            with: vec![with.to_owned()],
            of: Box::new(move |residuals| vec![of(residuals)]),
        }
    }

    /// Of what `before` goes with most; none where there is nothing to go with.
    fn tested(
        &self,
        before: &ResidualSet,
        after: &ResidualSet,
        null_samples: &[ResidualSet],
        chance: f64,
    ) -> Option<TestResult> {
        let size = |v: &f64| if v.is_finite() { v.abs() } else { 0.0 };
        let most = |values: &[f64]| values.iter().map(size).fold(0.0, f64::max);
        let all = (self.of)(before);
        let best = (0..all.len()).max_by(|a, b| size(&all[*a]).total_cmp(&size(&all[*b])))?;
        let fault_free: Vec<f64> = null_samples
            .iter()
            .map(|null_sample| most(&(self.of)(null_sample)))
            .collect();
        let by_chance = gumbel_quantile(&fault_free, chance).max(self.test.least());
        Some(TestResult {
            test: self.test,
            with: self.with[best].clone(),
            before: all[best],
            after: (self.of)(after)[best],
            by_chance: (self.test.most().is_none_or(|most| by_chance < most)).then_some(by_chance),
        })
    }
}

/// The tests of signal `k`.
fn measures<'a, S: ResidualModel>(
    recordings: &'a [S],
    k: usize,
    shafts: &'a [Turning],
    quantities: &'a [Vec<Covariate<'a>>],
    before: &ResidualSet,
) -> Vec<Measure<'a>> {
    let mut all = vec![
        Measure::alone(Test::Bias, "", move |r| bias(recordings, r, k)),
        Measure::alone(Test::Autocorrelation, "", move |r| autocorrelation(r, k)),
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
            // Looked up once, and not again in each null sample.
            let bins_of: Vec<Vec<Option<BinRange>>> = (recordings.iter().zip(along))
                .map(|(s, along)| bins.bins_of(&along.values, s.block()))
                .collect();
            let explained_by_bins = move |r: &ResidualSet| {
                let samples = bins_of.iter().zip(r).flat_map(|(at, r)| binned(at, &r[k]));
                explained_by_bins(&samples.collect::<Vec<_>>()).max(0.0)
            };
            all.push(Measure::alone(
                Test::Covariate,
                along[0].quantity,
                explained_by_bins,
            ));
        }
    }
    let others: Vec<usize> = (0..before[0].len()).filter(|j| *j != k).collect();
    all.push(Measure {
        test: Test::CrossCorrelation,
        with: others
            .iter()
            .map(|j| recordings[0].name(*j).to_owned())
            .collect(),
        of: Box::new(move |r| others.iter().map(|j| correlation(r, k, *j)).collect()),
    });
    all
}

fn bias<S: ResidualModel>(recordings: &[S], residuals: &ResidualSet, k: usize) -> f64 {
    let means: Vec<f64> = (recordings.iter().zip(residuals))
        .flat_map(|(s, r)| r[k].chunks(s.block()))
        .map(|block| mean(block.iter().copied()))
        .filter(|m| m.is_finite())
        .collect();
    let middle = mean(means.iter().copied());
    let variance = mean(means.iter().map(|m| (m - middle).powi(2)));
    middle / (variance / (means.len() as f64 - 1.0)).sqrt()
}

fn autocorrelation(residuals: &ResidualSet, k: usize) -> f64 {
    let mut sequence = Autocorrelation::default();
    residuals
        .iter()
        .flat_map(|r| &r[k])
        .for_each(|v| sequence.push(*v));
    let squares = sequence.coefficients().into_iter().flatten().map(|r| r * r);
    mean(squares).sqrt()
}

/// `cos phi`, `sin phi` and the step of `phi` for each sample of a shaft, `[recording][sample]`.
type Waves = Vec<Vec<[f64; 3]>>;

fn wave(angle: &[f64]) -> Vec<[f64; 3]> {
    let next = angle.iter().skip(1).chain(angle.last());
    (angle.iter().zip(next))
        .map(|(a, next)| [a.cos(), a.sin(), (next - a).abs()])
        .collect()
}

/// A shaft as it turned in the recordings.
struct Turning {
    name: String,
    /// Orders that turn often enough to be distinguished from a drift and are slow enough for the sampling.
    orders: Vec<usize>,
    waves: Waves,
}

impl Turning {
    /// Shaft `number` of `recordings`.
    fn of<S: ResidualModel>(recordings: &[S], number: usize) -> Self {
        let waves: Waves = (recordings.iter())
            .map(|recording| wave(&recording.shafts()[number].angle))
            .collect();
        let steps = || waves.iter().flatten().map(|w| w[2]).filter(|w| *w > 0.0);
        let (turned, samples): (f64, f64) = (steps().sum(), steps().count() as f64);
        let orders = (1..=ORDERS)
            .filter(|o| *o as f64 * turned >= PERIODS * TAU)
            .filter(|o| *o as f64 * turned <= 0.8 * PI * samples)
            .collect();
        Self {
            name: recordings[0].shafts()[number].name.to_owned(),
            orders,
            waves,
        }
    }
}

/// The part of signal `k` in each order, from the first; over the angle, so that a standstill
/// contributes nothing. A recording in which an order does not turn `PERIODS` times has no part in it.
fn orders_of(waves: &Waves, residuals: &ResidualSet, k: usize) -> [f64; ORDERS] {
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

fn correlation(residuals: &ResidualSet, k: usize, j: usize) -> f64 {
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

    fn residuals(signals: &[&dyn Fn(f64) -> f64]) -> ResidualSet {
        let mut white = noise(1);
        let signal =
            |of: &&dyn Fn(f64) -> f64| (0..20_000).map(|i| of(f64::from(i)) + white()).collect();
        vec![signals.iter().map(signal).collect()]
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
    fn autocorrelation_distinguishes_a_wave_from_white_noise() {
        let of = residuals(&[&|_| 3.0, &|i| (0.02 * i).sin()]);
        assert!(
            autocorrelation(&of, 0) < 0.01,
            "{}",
            autocorrelation(&of, 0)
        );
        assert!(autocorrelation(&of, 1) > 0.7, "{}", autocorrelation(&of, 1));
    }
}
