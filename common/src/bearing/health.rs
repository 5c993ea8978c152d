//! Whether a gauge still answers to the balls.

use super::block::Block;
use super::joint::Told;
use super::{BASIS, GAUGES, GaugeModel};
use crate::fault::Fault;

/// Blocks of a window over which a gauge is judged.
const WINDOW: u16 = 25;

/// Windows in a row in which a gauge is silent though it should be heard: a belief that is still on
/// its way expects anything for a quarter of a second.
const PATIENCE: u8 = 2;

/// Mean square of the local strain over what noise alone comes to: below the first a gauge is silent,
/// above the second it is heard. The third is what the champion must expect of a silent one, three times the noise.
///
/// Noise scatters by `sqrt(2 / 150) = 0.12` over the window's 25 blocks of six readings: the first is four of these from it.
/// Silence alone is no fault: without a moment a live gauge may hear nothing for half a second.
const SILENT: f32 = 1.5;
const HEARD: f32 = 2.0;
const EXPECTED: f32 = 9.0;

/// What is known of the gauges, judged four times a second.
#[derive(Clone, Copy, Debug, Default)]
pub struct Health {
    /// Mean square of local strain over that of noise, read and expected, summed over the window.
    sums: [(f32, f32); GAUGES],
    /// Blocks of the window in which each gauge gave every reading.
    whole: [u16; GAUGES],
    blocks: u16,
    /// Windows in a row in which each was silent against expectation.
    silent: [u8; GAUGES],
    fault: [Fault; GAUGES],
}

impl Health {
    /// Takes in what the gauges said of a block to the champion.
    ///
    /// True when a gauge has just fallen silent.
    pub fn take(
        &mut self,
        told: &[Told; GAUGES],
        block: &Block,
        gauges: &[GaugeModel; GAUGES],
    ) -> bool {
        let readings = (BASIS - 1) as f32 / f32::from(block.count.max(1));
        for g in 0..GAUGES {
            if !block.whole[g] {
                continue;
            }
            let noise = gauges[g].noise_std * gauges[g].noise_std * readings;
            let (read, expected) = told[g].local;
            self.sums[g].0 += read * read / noise;
            self.sums[g].1 += expected * expected / noise;
            self.whole[g] = self.whole[g].saturating_add(1);
        }
        self.blocks = self.blocks.saturating_add(1);
        if self.blocks < WINDOW {
            return false;
        }
        let mut fell_silent = false;
        for g in 0..GAUGES {
            let count = f32::from(self.whole[g].max(1));
            let (read, expected) = (self.sums[g].0 / count, self.sums[g].1 / count);
            let missed = self.whole[g] == WINDOW && read < SILENT && expected > EXPECTED;
            self.silent[g] = if missed {
                self.silent[g].saturating_add(1)
            } else {
                0
            };
            if read > HEARD {
                self.fault[g] = Fault::None;
            } else if self.silent[g] >= PATIENCE && self.fault[g].is_none() {
                self.fault[g] = Fault::Stuck;
                fell_silent = true;
            }
        }
        self.sums = Default::default();
        self.whole = Default::default();
        self.blocks = 0;
        fell_silent
    }

    /// What is wrong with a gauge.
    pub fn fault(&self, g: usize) -> Fault {
        self.fault[g % GAUGES]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measurement::Converter;

    /// Blocks until a gauge that reads and is expected at these multiples of its noise is named; 200 at most.
    fn named_after(read: f32, expected: f32) -> Option<usize> {
        let gauge = GaugeModel {
            converter: Converter {
                zero: 0,
                gain: 1.0,
                lowest: -1,
                highest: 1,
                stuck_after: 0,
            },
            passing: 0.0,
            noise_std: 0.8,
            resting_error: 0.0,
            model_error: 0.0,
            offset: 0.0,
            bulk_load: Default::default(),
            bulk_feature: Default::default(),
            local: Default::default(),
        };
        let gauges = [0; GAUGES].map(|_| gauge.clone());
        let block = Block {
            count: 20,
            whole: [true; GAUGES],
            ..Block::default()
        };
        // Six readings of noise in 20 samples.
        let noise = 0.8 * libm::sqrtf(6.0 / 20.0);
        let mut told = [Told::default(); GAUGES];
        told[3].local = (read * noise, expected * noise);
        let mut health = Health::default();
        (1..=200).find(|_| health.take(&told, &block, &gauges))
    }

    #[test]
    fn silence_names_a_gauge_only_where_it_should_be_heard() {
        assert_eq!(named_after(1.0, 10.0), Some(50));
        assert_eq!(named_after(1.0, 1.5), None);
        assert_eq!(named_after(1.5, 10.0), None);
    }
}
