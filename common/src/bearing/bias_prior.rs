//! Holds mean and covariance of a bearing's slow states, preload and gauge biases (`BiasPrior`):
//! reads them from a posterior, writes them into another, and computes their chi-squared distance
//! from another set. Also predicts the biases by one block, with correlated drift.

use nalgebra::SVector;
use serde::{Deserialize, Serialize};

use crate::bearing::ekf::{BIAS_INDEX, DRIFT_CORRELATION, JointEkf, NX, PRELOAD_INDEX};
use crate::bearing::{GAUGES, Tuning};
use crate::kalman::gaussian::factor;

/// Which slow states an update does not change.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hold {
    /// None.
    Nothing,
    /// The biases.
    Biases,
    /// Preload and biases.
    All,
}

/// Preload and biases.
pub(crate) const OFFSETS: usize = 1 + GAUGES;

/// Mean and covariance of preload (um) and gauge biases (um/m).
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct BiasPrior {
    pub(crate) mean: [f32; OFFSETS],
    /// Covariance, upper triangle by columns.
    pub(crate) upper: [[f32; OFFSETS]; OFFSETS],
}

impl BiasPrior {
    /// Zero mean with the standard deviations of `tuning`, before any reading.
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

    /// Squared distance of another mean from this one, in units of this covariance plus the random
    /// walk of `time_s`: chi-squared with five degrees of freedom; none where that covariance is
    /// not positive.
    pub(crate) fn distance(&self, other: &Self, tuning: &Tuning, time_s: f32) -> Option<f32> {
        let u = factor(&self.after(tuning, time_s))?;
        let mut solve = [0.0; OFFSETS];
        let mut sum = 0.0;
        for i in (0..OFFSETS).rev() {
            let mut part = other.mean[i] - self.mean[i];
            for m in i + 1..OFFSETS {
                part -= u[m][i] * solve[m];
            }
            solve[i] = part;
            sum += part * part / u[i][i];
        }
        Some(sum)
    }

    /// This covariance plus the random walk of `time_s`.
    fn after(&self, tuning: &Tuning, time_s: f32) -> [[f32; OFFSETS]; OFFSETS] {
        let mut p = self.upper;
        let walk = 2.0 * time_s / tuning.bias_time_s * tuning.bias_std * tuning.bias_std;
        p[0][0] += tuning.preload_walk * tuning.preload_walk * time_s;
        for j in 1..OFFSETS {
            for i in 1..j {
                p[j][i] += DRIFT_CORRELATION * walk;
            }
            p[j][j] += walk;
        }
        p
    }

    /// Moves mean and covariance by `share` towards another one: a step of a low-pass.
    pub(crate) fn follow(&mut self, other: &Self, share: f32) {
        for j in 0..OFFSETS {
            self.mean[j] += share * (other.mean[j] - self.mean[j]);
            for i in 0..=j {
                self.upper[j][i] += share * (other.upper[j][i] - self.upper[j][i]);
            }
        }
    }
}

/// Sets the covariances of state `i` with all others to 0; its variance stays.
#[inline(never)]
pub(super) fn decorrelate_state(p: &mut [[f32; NX]; NX], i: usize) {
    for (j, column) in p.iter_mut().enumerate() {
        // Column j ends at the diagonal.
        if j == i {
            column.iter_mut().take(i).for_each(|entry| *entry = 0.0);
        } else if let Some(entry) = column.get_mut(i).filter(|_| j > i) {
            *entry = 0.0;
        }
    }
}

/// Predicts the biases by one block, each a Gauss-Markov process: `x+ = k x`,
/// `P+ = k P k + (1 - k^2) std^2 C`, `k = 1 - share`; `C` is 1 on its diagonal and
/// [`DRIFT_CORRELATION`] elsewhere.
pub(super) fn propagate_bias(
    x: &mut SVector<f32, NX>,
    p: &mut [[f32; NX]; NX],
    share: f32,
    std: f32,
) {
    let keep = 1.0 - share.min(1.0);
    let new = (1.0 - keep * keep) * std * std;
    for i in BIAS_INDEX..NX {
        x[i] *= keep;
        for j in 0..NX {
            if j != i {
                p[i.max(j)][i.min(j)] *= keep;
            }
        }
        p[i][i] = keep * keep * p[i][i] + new;
    }
    for (j, column) in p.iter_mut().enumerate().skip(BIAS_INDEX) {
        for entry in column.iter_mut().take(j).skip(BIAS_INDEX) {
            *entry += DRIFT_CORRELATION * new;
        }
    }
}

impl JointEkf {
    /// Mean and covariance of preload and biases in this posterior.
    pub fn offsets(&self) -> BiasPrior {
        let mut offsets = BiasPrior::default();
        for j in 0..OFFSETS {
            offsets.mean[j] = self.gaussian.state[PRELOAD_INDEX + j];
            for i in 0..=j {
                offsets.upper[j][i] = self.gaussian.upper[PRELOAD_INDEX + j][PRELOAD_INDEX + i];
            }
        }
        offsets
    }

    /// Sets mean and covariance of preload and biases back to `offsets` after an update; their
    /// correlation to other states stays (Schmidt: considered, not updated).
    pub(super) fn hold_offsets(&mut self, offsets: &BiasPrior, hold: Hold) {
        let first = match hold {
            Hold::Nothing => OFFSETS,
            Hold::Biases => 1,
            Hold::All => 0,
        };
        for j in first..OFFSETS {
            self.gaussian.state[PRELOAD_INDEX + j] = offsets.mean[j];
            for i in first..=j {
                self.gaussian.upper[PRELOAD_INDEX + j][PRELOAD_INDEX + i] = offsets.upper[j][i];
            }
        }
    }

    /// Replaces mean and covariance of preload and biases by `offsets`, without correlation to
    /// other states: its own may have been estimated with the rows exchanged.
    pub fn set_offsets(&mut self, offsets: &BiasPrior) {
        let p = &mut self.gaussian.upper;
        for j in 0..OFFSETS {
            self.gaussian.state[PRELOAD_INDEX + j] = offsets.mean[j];
            decorrelate_state(p, PRELOAD_INDEX + j);
        }
        for j in 0..OFFSETS {
            for i in 0..=j {
                p[PRELOAD_INDEX + j][PRELOAD_INDEX + i] = offsets.upper[j][i];
            }
        }
    }
}

#[cfg(test)]
impl BiasPrior {
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
