//! Whether a gauge still answers to the balls.

use super::joint::Told;
use super::{GAUGES, GaugeModel};
use crate::fault::Fault;

/// Blocks over which a gauge is judged.
const JUDGED_BLOCKS: f32 = 25.0;

/// Root mean square of the local strain over the noise of a sample: below the first a gauge
/// is silent, above the second it is heard, above the third it would be heard at any gauge.
///
/// Noise alone comes to `sqrt(6 / 20)` of it with 20 samples a block. Even a gauge whose own
/// contacts carry nothing hears how the ring bends under the others.
const SILENT: f32 = 1.0;
const HEARD: f32 = 2.0;
const LOUD: f32 = 10.0;

/// Records of all gauges over the last quarter of a second.
#[derive(Clone, Copy, Debug, Default)]
pub struct Health {
    /// Root mean square of each gauge's local strain over its noise.
    heard: [f32; GAUGES],
    blocks: u16,
    fault: [Fault; GAUGES],
}

impl Health {
    /// Takes in what the gauges said of a block; `whole`: those that gave every reading.
    ///
    /// True when a gauge has just fallen silent.
    pub fn take(
        &mut self,
        told: &[Told; GAUGES],
        whole: [bool; GAUGES],
        gauges: &[GaugeModel; GAUGES],
    ) -> bool {
        self.blocks = self.blocks.saturating_add(1);
        let share = 1.0 / JUDGED_BLOCKS.min(f32::from(self.blocks));
        let mut loudest: f32 = 0.0;
        for g in 0..GAUGES {
            if whole[g] {
                let heard = told[g].local.0 / gauges[g].noise_std;
                self.heard[g] += share * (heard - self.heard[g]);
                loudest = loudest.max(self.heard[g]);
            }
        }
        let mut fell_silent = false;
        for (fault, heard) in self.fault.iter_mut().zip(&self.heard) {
            let judged = f32::from(self.blocks) >= JUDGED_BLOCKS;
            if *heard > HEARD {
                *fault = Fault::None;
            } else if judged && *heard < SILENT && loudest > LOUD && fault.is_none() {
                *fault = Fault::Stuck;
                fell_silent = true;
            }
        }
        fell_silent
    }

    /// What is wrong with a gauge.
    pub fn fault(&self, g: usize) -> Fault {
        self.fault[g % GAUGES]
    }
}
