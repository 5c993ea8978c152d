//! What rows have learnt of preload and biases, to be handed to other beliefs.

use super::Tuning;
use super::joint::{Belief, NX, PRELOAD, uncouple};

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
