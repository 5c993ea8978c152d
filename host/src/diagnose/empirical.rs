//! A correction without a cause: what a residual is, on average, over something that was measured.

use serde::Serialize;

use super::observed::{Abscissa, Observed};
use super::structure::Oddity;

/// Values between which the correction is told, each with as many samples.
const BINS: usize = 24;

/// Part of a residual's mean square that a correction must take from blocks left out.
const WORTH: f64 = 0.2;

/// What may be subtracted from a reading, though nobody knows why.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Correction {
    /// The residual.
    pub channel: String,
    /// Unit of what is subtracted.
    pub unit: &'static str,
    /// What it is over.
    pub over: &'static str,
    /// Unit of that.
    pub over_unit: &'static str,
    /// Part of the mean square about its mean that it takes from blocks left out.
    pub takes: f64,
    /// Middles of the bins, rising.
    pub at: Vec<f64>,
    /// What is subtracted there, about the mean.
    pub subtract: Vec<f64>,
}

/// For each residual that is larger than a clean machine's the correction that takes most of it,
/// where one takes enough. Time is no cause: what it explains is not there in the next recording.
pub fn corrections<S: Observed>(sessions: &[S], oddities: &[Oddity]) -> Vec<Correction> {
    // Of each quantity, recording by recording.
    let mut along: Vec<Vec<Abscissa>> = Vec::new();
    for session in sessions {
        let measured = session.abscissae().into_iter();
        for (a, abscissa) in measured.filter(|a| a.quantity != "Time").enumerate() {
            along.resize_with(along.len().max(a + 1), Vec::new);
            along[a].push(abscissa);
        }
    }
    // Not every recording has a temperature.
    along.retain(|of| of.len() == sessions.len());
    let strange = (0..oddities.len()).filter(|k| oddities[*k].before > 1.1);
    let best = |k: usize| {
        (along.iter())
            .filter_map(|along| over(sessions, k, along))
            .max_by(|a, b| a.takes.total_cmp(&b.takes))
    };
    let mut all: Vec<Correction> = strange.filter_map(best).collect();
    all.sort_by(|a, b| b.takes.total_cmp(&a.takes));
    all
}

/// Of stream `k` over one quantity.
fn over<S: Observed>(sessions: &[S], k: usize, along: &[Abscissa]) -> Option<Correction> {
    let mut samples = Vec::new();
    for (session, along) in sessions.iter().zip(along) {
        let known = session.residual(k).iter().zip(along.values.iter());
        samples.extend(
            (known.enumerate())
                .filter(|(_, (y, x))| y.is_finite() && x.is_finite())
                .map(|(i, (y, x))| (*x, *y, i / session.block() % 2)),
        );
    }
    let bins = Bins::of(&samples)?;
    let takes = bins.takes(&samples);
    let subtract = bins.means(samples.iter().map(|(x, y, _)| (*x, *y)));
    (takes > WORTH).then(|| Correction {
        channel: sessions[0].name(k).to_owned(),
        unit: sessions[0].unit(k),
        over: along[0].quantity,
        over_unit: along[0].unit,
        takes,
        at: bins.middles,
        subtract,
    })
}

/// Bins with as many samples each.
struct Bins {
    /// Upper ends of all but the last.
    ends: Vec<f64>,
    middles: Vec<f64>,
}

impl Bins {
    /// Of the first values of `samples`; none where they are too few or all the same.
    fn of(samples: &[(f64, f64, usize)]) -> Option<Self> {
        let mut values: Vec<f64> = samples.iter().map(|s| s.0).collect();
        values.sort_by(f64::total_cmp);
        let n = values.len();
        if n < 4 * BINS || values[n / 20] == values[n - 1 - n / 20] {
            return None;
        }
        let at = |twice: usize| values[(twice * n / (2 * BINS)).min(n - 1)];
        Some(Self {
            ends: (1..BINS).map(|b| at(2 * b)).collect(),
            middles: (0..BINS).map(|b| at(2 * b + 1)).collect(),
        })
    }

    fn bin(&self, x: f64) -> usize {
        self.ends.partition_point(|end| *end < x)
    }

    /// Mean of `(x, y)` in each bin about the mean of all; 0 where there is none.
    fn means(&self, samples: impl Iterator<Item = (f64, f64)> + Clone) -> Vec<f64> {
        let (mut sums, mut counts) = (vec![0.0; BINS], vec![0.0_f64; BINS]);
        for (x, y) in samples {
            let bin = self.bin(x);
            sums[bin] += y;
            counts[bin] += 1.0;
        }
        let mean = sums.iter().sum::<f64>() / counts.iter().sum::<f64>().max(1.0);
        (sums.iter().zip(&counts))
            .map(|(sum, n)| if *n > 0.0 { sum / n - mean } else { 0.0 })
            .collect()
    }

    /// Part of the mean square about the mean that the means of every other block take from the
    /// rest.
    fn takes(&self, samples: &[(f64, f64, usize)]) -> f64 {
        let (mut left, mut whole) = (0.0, 0.0);
        for half in 0..2 {
            let of = |half: usize| (samples.iter()).filter(move |s| s.2 == half);
            let means = self.means(of(1 - half).map(|s| (s.0, s.1)));
            let n = of(half).count().max(1) as f64;
            let mean = of(half).map(|s| s.1).sum::<f64>() / n;
            for (x, y, _) in of(half) {
                whole += (y - mean).powi(2);
                left += (y - mean - means[self.bin(*x)]).powi(2);
            }
        }
        1.0 - left / f64::max(whole, 1e-300)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `(x, y, half)`: x goes round, y is `of` x and noise.
    fn samples(of: impl Fn(f64) -> f64) -> Vec<(f64, f64, usize)> {
        let mut noise = 1_u32;
        (0..20_000)
            .map(|i| {
                noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let x = f64::from(i) * 0.037 % std::f64::consts::TAU;
                let white = f64::from(noise) / f64::from(u32::MAX) - 0.5;
                (x, of(x) + 0.1 * white, (i / 100 % 2) as usize)
            })
            .collect()
    }

    #[test]
    fn what_goes_with_a_quantity_is_taken_and_noise_is_not() {
        let wave = samples(f64::sin);
        let bins = Bins::of(&wave).unwrap();
        assert!(bins.takes(&wave) > 0.95);
        let means = bins.means(wave.iter().map(|s| (s.0, s.1)));
        for (x, mean) in bins.middles.iter().zip(means) {
            assert!((mean - x.sin()).abs() < 0.05, "{x} {mean}");
        }
        let noise = samples(|_| 0.0);
        assert!(Bins::of(&noise).unwrap().takes(&noise) < 0.01);
    }

    #[test]
    fn nothing_is_told_over_what_does_not_move() {
        let still: Vec<(f64, f64, usize)> = (samples(f64::sin).into_iter())
            .map(|(_, y, half)| (1.0, y, half))
            .collect();
        assert!(Bins::of(&still).is_none());
    }
}
