//! What rows have learnt of preload and biases, to be handed to other beliefs.

use super::Tuning;
use super::joint::{Belief, NX, PRELOAD, TOGETHER, uncouple};
use crate::gaussian::factor;

/// Preload and biases.
const OFFSETS: usize = NX - PRELOAD;

/// Preload [um] and biases [um/m], as a belief has learnt them.
#[derive(Clone, Copy, Debug, Default)]
pub struct Offsets {
    mean: [f32; OFFSETS],
    /// Covariance, upper triangle by columns.
    upper: [[f32; OFFSETS]; OFFSETS],
}

impl Offsets {
    /// Before anything is learnt.
    pub fn expected(tuning: &Tuning) -> Self {
        let mut offsets = Self::default();
        for (i, column) in offsets.upper.iter_mut().enumerate() {
            let std = if i == 0 {
                tuning.preload_std
            } else {
                tuning.bias_std
            };
            column[i] = std * std;
        }
        offsets
    }

    /// Distance of other preload and biases from these, squared, in units of the covariance of these with what they walk
    /// in `time_s`: chi-squared; none where the covariance is not positive.
    pub(super) fn distance(&self, other: &Self, tuning: &Tuning, time_s: f32) -> Option<f32> {
        let mut p = self.upper;
        let walk = 2.0 * time_s / tuning.bias_time_s * tuning.bias_std * tuning.bias_std;
        p[0][0] += tuning.preload_walk * tuning.preload_walk * time_s;
        for j in 1..OFFSETS {
            for i in 1..j {
                p[j][i] += TOGETHER * walk;
            }
            p[j][j] += walk;
        }
        let u = factor(&p)?;
        let mut whitened = [0.0; OFFSETS];
        let mut sum = 0.0;
        for i in (0..OFFSETS).rev() {
            let mut part = other.mean[i] - self.mean[i];
            for m in i + 1..OFFSETS {
                part -= u[m][i] * whitened[m];
            }
            whitened[i] = part;
            sum += part * part / u[i][i];
        }
        Some(sum)
    }

    /// Moves these by `share` towards others, mean and covariance.
    pub(super) fn follow(&mut self, other: &Self, share: f32) {
        for j in 0..OFFSETS {
            self.mean[j] += share * (other.mean[j] - self.mean[j]);
            for i in 0..=j {
                self.upper[j][i] += share * (other.upper[j][i] - self.upper[j][i]);
            }
        }
    }
}

#[cfg(test)]
impl Offsets {
    /// With these means and standard deviations, independent.
    pub fn known(mean: &[f32; OFFSETS], std: &[f32; OFFSETS]) -> Self {
        let mut offsets = Self {
            mean: *mean,
            ..Self::default()
        };
        for (i, std) in std.iter().enumerate() {
            offsets.upper[i][i] = std * std;
        }
        offsets
    }

    /// With means moved.
    #[must_use]
    pub fn moved(&self, by: &[f32; OFFSETS]) -> Self {
        let mut offsets = *self;
        for (mean, by) in offsets.mean.iter_mut().zip(by) {
            *mean += by;
        }
        offsets
    }
}

impl Belief {
    /// Preload and biases as they are believed now.
    pub fn offsets(&self) -> Offsets {
        let mut offsets = Offsets::default();
        for j in 0..OFFSETS {
            offsets.mean[j] = self.gaussian.state[PRELOAD + j];
            for i in 0..=j {
                offsets.upper[j][i] = self.gaussian.upper[PRELOAD + j][PRELOAD + i];
            }
        }
        offsets
    }

    /// Takes preload and biases from `offsets`: what it has taken up itself may belong to other rows.
    pub fn recall(&mut self, offsets: &Offsets) {
        let p = &mut self.gaussian.upper;
        for j in 0..OFFSETS {
            self.gaussian.state[PRELOAD + j] = offsets.mean[j];
            uncouple(p, PRELOAD + j);
        }
        for j in 0..OFFSETS {
            for i in 0..=j {
                p[PRELOAD + j][PRELOAD + i] = offsets.upper[j][i];
            }
        }
    }
}
