//! Compares parameters of a drivetrain on data that took no part in their fit (`HeldOut`): by how much the
//! residuals are smaller, with its interval, and residuals of each sensor.

use std::collections::BTreeMap;

use super::data_part::{DataPart, Stretch};
use super::posterior::Posterior;
use crate::regression::normal_equations::dot;

/// Length of the blocks whose gains count as independent [s]: twice the smoothing of accelerations, 0.6 s.
const BLOCK_S: f64 = 1.2;

/// Deviations of a normal distribution that 95 % lie within.
const WITHIN_95: f64 = 1.96;

/// By how much residuals are smaller, as the logarithm of their ratio: 0.01 is 1 %.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gain {
    /// Estimate.
    pub value: f64,
    /// 95 % interval.
    pub interval: [f64; 2],
}

impl Gain {
    /// Of the gains of blocks: median of the means of all pairs, and the interval that the signed-rank test gives,
    /// whatever their distribution. A block in which the machine vibrates gains many times what others gain. None
    /// without a block.
    ///
    /// Source: Hodges and Lehmann 1963, "Estimates of location based on rank tests".
    fn of(blocks: &[f64]) -> Option<Self> {
        let n = blocks.len();
        let pairs = (0..n).flat_map(|i| (i..n).map(move |j| (i, j)));
        let mut means: Vec<f64> = pairs.map(|(i, j)| 0.5 * (blocks[i] + blocks[j])).collect();
        means.sort_by(f64::total_cmp);
        let last = means.len().checked_sub(1)?;
        let n = n as f64;
        let deviation = (n * (n + 1.0) * (2.0 * n + 1.0) / 24.0).sqrt();
        // Below zero of so few blocks that no interval excludes anything.
        let outside = n * (n + 1.0) / 4.0 - WITHIN_95 * deviation;
        let interval = if outside >= 1.0 {
            let outside = outside as usize - 1;
            [means[outside], means[last - outside]]
        } else {
            [f64::NEG_INFINITY, f64::INFINITY]
        };
        Some(Self {
            value: 0.5 * (means[last / 2] + means[last - last / 2]),
            interval,
        })
    }
}

/// Residuals of one sensor over the held-out data.
#[derive(Clone, Debug)]
pub struct SensorError {
    /// Channel, encoder, or `torque balance`.
    pub name: String,
    /// Its unit.
    pub unit: &'static str,
    /// Root mean square as described.
    pub rms_before: f64,
    /// The same with the parameters fitted.
    pub rms_after: f64,
}

/// Data that took no part in a fit.
pub(super) struct HeldOut<'a> {
    data: &'a DataPart<'a>,
    /// Part of the samples of each stretch that is independent, by the fit.
    independent: Vec<f64>,
}

impl<'a> HeldOut<'a> {
    /// `data` beside the `fitted` data from which `posterior` comes.
    pub fn new(data: &'a DataPart<'a>, fitted: &DataPart<'_>, posterior: &Posterior) -> Self {
        let part = |stretch: &Stretch| {
            let same = fitted.stretches.iter().position(|s| s.of == stretch.of);
            same.map_or(0.0, |k| {
                posterior.samples[k] / fitted.stretches[k].known.len() as f64
            })
        };
        Self {
            independent: data.stretches.iter().map(part).collect(),
            data,
        }
    }

    /// Time of the sensor that has most [s].
    pub fn duration_s(&self) -> f64 {
        let sensors = |k: usize| self.data.stretches.iter().filter(move |s| s.of[1] == k);
        let samples = |k: usize| sensors(k).map(|s| s.known.len()).sum::<usize>();
        let most = self.data.stretches.iter().map(|s| samples(s.of[1])).max();
        most.unwrap_or(0) as f64 * self.data.dt_s()
    }

    /// Gain from the parameters at `before` to those at `after`: the [`Gain`] of blocks, each
    ///
    /// `sum_k n_k ln(s_k / s'_k) / sum_k n_k`
    ///
    /// with the root mean square `s_k` of sensor `k` in the block and its independent samples `n_k`. None without
    /// data.
    pub fn gain(&self, before: &[f64], after: &[f64]) -> Option<Gain> {
        let (was, is) = (self.data.residuals(before), self.data.residuals(after));
        let block = (BLOCK_S / self.data.dt_s()) as usize;
        let mut blocks: BTreeMap<[usize; 2], (f64, f64)> = BTreeMap::new();
        for (k, stretch) in self.data.stretches.iter().enumerate() {
            let mut squares: BTreeMap<usize, [f64; 3]> = BTreeMap::new();
            for (j, i) in stretch.known.iter().enumerate() {
                let of_block = squares.entry(i / block).or_default();
                let own = [was[k][j].powi(2), is[k][j].powi(2), 1.0];
                of_block.iter_mut().zip(own).for_each(|(s, x)| *s += x);
            }
            for (at, [was, is, count]) in squares {
                let samples = self.independent[k] * count;
                let least = f64::MIN_POSITIVE;
                let gain = 0.5 * (was.max(least) / is.max(least)).ln();
                let sums = blocks.entry([stretch.of[0], at]).or_default();
                sums.0 += samples * gain;
                sums.1 += samples;
            }
        }
        let blocks = blocks.into_values().filter(|block| block.1 > 0.0);
        let gains: Vec<f64> = blocks.map(|(sum, samples)| sum / samples).collect();
        Gain::of(&gains)
    }

    /// Whether the parameters at `after` predict better than those at `before`, beyond the 95 % interval of the
    /// difference.
    pub fn is_better(&self, before: &[f64], after: &[f64]) -> bool {
        let gain = self.gain(before, after);
        gain.is_some_and(|gain| gain.interval[0] > 0.0)
    }

    /// Residuals of each sensor over all recordings.
    pub fn sensor_errors(&self, before: &[f64], after: &[f64]) -> Vec<SensorError> {
        let residuals = [before, after].map(|offsets| self.data.residuals(offsets));
        let mut sensors: Vec<usize> = self.data.stretches.iter().map(|s| s.of[1]).collect();
        sensors.sort_unstable();
        sensors.dedup();
        let error = |sensor: usize| {
            let of = |s: &&(usize, &Stretch)| s.1.of[1] == sensor;
            let all: Vec<(usize, &Stretch)> = self.data.stretches.iter().enumerate().collect();
            let stretches = all.iter().filter(of);
            let samples: usize = stretches.clone().map(|(_, s)| s.known.len()).sum();
            let [rms_before, rms_after] = residuals.each_ref().map(|residuals| {
                let squares = stretches
                    .clone()
                    .map(|(k, _)| dot(&residuals[*k], &residuals[*k]));
                (squares.sum::<f64>() / samples as f64).sqrt()
            });
            let first = all.iter().find(of)?.1;
            let signal = &self.data.sensor(first).signal;
            Some(SensorError {
                name: signal.name.clone(),
                unit: signal.unit,
                rms_before,
                rms_after,
            })
        };
        sensors.into_iter().filter_map(error).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::Gain;

    /// By hand: of -1, 0, 1 the means of pairs are -1, -0.5, 0, 0, 0.5, 1; three blocks exclude nothing. Eight
    /// blocks of 1 to 8: 36 pairs, 3 outside on either side.
    #[test]
    fn the_gain_is_the_median_of_pairs() {
        assert_eq!(Gain::of(&[]), None);
        let few = Gain::of(&[-1.0, 0.0, 1.0]).unwrap();
        assert_eq!((few.value, few.interval[0]), (0.0, f64::NEG_INFINITY));
        let found = Gain::of(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]).unwrap();
        assert_eq!((found.value, found.interval), (4.5, [2.0, 7.0]));
    }

    /// One block that gains a thousand times as much widens nothing, where all gain; half of them gaining and half
    /// losing shows nothing.
    #[test]
    fn a_block_that_vibrates_counts_as_one() {
        let mut blocks: Vec<f64> = (0..16).map(|i| 0.01 + 0.001 * f64::from(i)).collect();
        blocks[3] = 20.0;
        assert!(Gain::of(&blocks).unwrap().interval[0] > 0.01);
        for block in blocks.iter_mut().step_by(2) {
            *block = -*block;
        }
        let [low, high] = Gain::of(&blocks).unwrap().interval;
        assert!(low < 0.0 && high > 0.0, "{low} {high}");
    }
}
