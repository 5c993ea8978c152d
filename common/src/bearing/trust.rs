//! How far the champion is to be trusted.

use super::joint::Told;
use super::{GAUGES, GaugeModel};

/// Part of the local strain's mean square that may stay unexplained, and the
/// blocks over which it is judged.
const UNEXPLAINED: f32 = 0.06;
const FITTED_BLOCKS: f32 = 16.0;

/// Mean normalised innovation squared of the worst gauge beyond which a belief is in
/// doubt, and the blocks over which it is taken.
const SURPRISE: f32 = 2.0;
const SURPRISED_BLOCKS: f32 = 8.0;

/// What a belief may hold against what is expected of it: 12 unknowns, seven
/// times what they come to on average.
const IMPLAUSIBLE: f32 = 80.0;

/// Blocks in doubt after which the search starts anew.
const PATIENCE: u16 = 40;

/// Part of a gauge's resting variance that is not taken for strain left unexplained.
const NOISE_SHARE: f32 = 2.7;

/// What speaks for and against a belief.
#[derive(Clone, Copy, Debug, Default)]
pub struct Trust {
    /// Mean square of the local strain, unexplained and read [(um/m)^2].
    left: f32,
    read: f32,
    surprise: f32,
    prior: f32,
    doubted: u16,
}

impl Trust {
    /// Takes in what the gauges said of a block; `used`: those that count;
    /// `prior`: of the belief, see [`super::joint::Belief::prior`].
    pub fn take(
        &mut self,
        told: &[Told; GAUGES],
        used: [bool; GAUGES],
        gauges: &[GaugeModel; GAUGES],
        prior: f32,
    ) {
        let (mut left, mut read, mut surprise) = (0.0, 0.0, 0.0_f32);
        for ((told, gauge), _) in told.iter().zip(gauges).zip(used).filter(|(_, used)| *used) {
            let noise = NOISE_SHARE * gauge.resting_variance();
            left += (told.left - noise).max(0.0);
            read += told.local.0 * told.local.0;
            surprise = surprise.max(told.nis);
        }
        self.left += (left - self.left) / FITTED_BLOCKS;
        self.read += (read - self.read) / FITTED_BLOCKS;
        self.surprise += (surprise - self.surprise) / SURPRISED_BLOCKS;
        self.prior = prior;
        self.doubted = if self.surprise > SURPRISE || self.prior > IMPLAUSIBLE {
            self.doubted.saturating_add(1)
        } else {
            0
        };
    }

    /// Whether readings and expectations are met.
    pub fn is_earned(&self) -> bool {
        self.doubted == 0 && self.left < UNEXPLAINED * self.read
    }

    /// Whether doubt has just come up.
    pub fn begins_to_doubt(&self) -> bool {
        self.doubted == 1
    }

    /// Whether it has been doubted for so long that nothing of it is worth keeping.
    pub fn is_lost(&self) -> bool {
        self.doubted > PATIENCE
    }
}
