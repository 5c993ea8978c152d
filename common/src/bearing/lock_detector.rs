//! Classifies the lock of a bearing's primary hypothesis after each block as confirmed, suspect or
//! lost, from the part of the local strain that it leaves unexplained, the NIS and the prior cost.
//! A lost lock starts the search for the phases anew.
//!
//! The limits were tuned on simulated bearings 1 to 4, 101 to 120 and 201 to 216; 121 to 130 took
//! no part (docs/lab/results.md).

use serde::{Deserialize, Serialize};

use crate::bearing::ekf::BlockInnovation;
use crate::bearing::{GAUGES, GaugeModel};

/// Part of the local strain's mean square that may stay unexplained in a confirmed posterior.
const UNEXPLAINED: f32 = 0.06;

/// Time constant of that mean square, in blocks of 10 ms.
const FIT_BLOCKS: f32 = 16.0;

/// Mean normalised innovation squared of the worst gauge beyond which a posterior is suspect; 1 in
/// a consistent filter.
const MAX_MEAN_NIS: f32 = 2.0;

/// Time constant of that mean, in blocks of 10 ms.
const NIS_BLOCKS: f32 = 8.0;

/// Largest prior cost of a posterior that is not suspect, a chi-squared of 12 unknowns: seven times
/// its mean. With 45 one set of development bearings was better and another worse
/// (docs/lab/tried.md).
const MAX_PRIOR_COST: f32 = 80.0;

/// Blocks of 10 ms under suspicion after which the search starts anew, 0.4 s.
const PATIENCE: u16 = 40;

/// Mean square of a gauge, in its resting variances, that is not taken for unexplained strain. The
/// six readings of a block of 20 samples leave 0.3 on average.
pub(crate) const NOISE_SHARE: f32 = 2.7;

/// Smoothed statistics of the primary hypothesis.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct LockDetector {
    /// Mean square of the local strain, unexplained and read [(um/m)^2].
    left: f32,
    read: f32,
    mean_nis: f32,
    prior: f32,
    suspect_blocks: u16,
}

impl LockDetector {
    /// Takes the innovations of the gauges in a block; `used`: those that count;
    /// `prior`: of the posterior, see [`crate::bearing::ekf::JointEkf::prior_cost`].
    pub fn update(
        &mut self,
        innovations: &[BlockInnovation; GAUGES],
        used: [bool; GAUGES],
        gauges: &[GaugeModel; GAUGES],
        prior: f32,
    ) {
        let (mut left, mut read, mut mean_nis) = (0.0, 0.0, 0.0_f32);
        for ((innovations, gauge), _) in innovations
            .iter()
            .zip(gauges)
            .zip(used)
            .filter(|(_, used)| *used)
        {
            let noise = NOISE_SHARE * gauge.resting_variance();
            left += (innovations.left - noise).max(0.0);
            read += innovations.local.0 * innovations.local.0;
            mean_nis = mean_nis.max(innovations.nis);
        }
        self.left += (left - self.left) / FIT_BLOCKS;
        self.read += (read - self.read) / FIT_BLOCKS;
        self.mean_nis += (mean_nis - self.mean_nis) / NIS_BLOCKS;
        self.prior = prior;
        self.suspect_blocks = if self.mean_nis > MAX_MEAN_NIS || self.prior > MAX_PRIOR_COST {
            self.suspect_blocks.saturating_add(1)
        } else {
            0
        };
    }

    /// Whether it explains the local strain and is not suspect.
    pub fn is_confirmed(&self) -> bool {
        self.suspect_blocks == 0 && self.left < UNEXPLAINED * self.read
    }

    /// Whether it has become suspect with the last block.
    pub fn is_suspect(&self) -> bool {
        self.suspect_blocks == 1
    }

    /// Whether it has been suspect for more than 40 blocks (0.4 s), so that the search starts anew.
    pub fn has_lost_lock(&self) -> bool {
        self.suspect_blocks > PATIENCE
    }
}
