//! Detects dead strain gauges of a bearing in windows of 25 blocks (0.25 s): reports `Stuck` for a
//! gauge that shows no ball-passing strain in two windows although the filter predicts it.

use serde::{Deserialize, Serialize};

use crate::bearing::ekf::BlockInnovation;
use crate::bearing::harmonic_block::HarmonicBlock;
use crate::bearing::{BASIS, GAUGES, GaugeModel};
use crate::io::fault::Fault;

/// Blocks of a window over which a gauge is evaluated, a quarter of a second.
const WINDOW: u16 = 25;

/// Consecutive windows in which a stuck gauge is silent: a filter that has not converged may
/// predict wrongly for one.
const PATIENCE: u8 = 2;

/// Mean square of local strain over that of noise below which a gauge is silent. Noise scatters by
/// `sqrt(2 / 150) = 0.12` over the window's 25 blocks of six readings: four of these above 1.
const DEAD_RATIO: f32 = 1.5;

/// Mean square of local strain over that of noise above which a gauge is live: eight such scatters
/// above 1.
const ALIVE_RATIO: f32 = 2.0;

/// Mean square of the predicted strain over that of noise from which silence counts, three standard
/// deviations of noise: without a moment a live gauge may be silent for half a second.
const EXPECTED: f32 = 9.0;

/// Fault of each gauge, evaluated four times a second.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct GaugeHealth {
    /// Mean square of local strain over that of noise, read and expected, summed over the window.
    sums: [(f32, f32); GAUGES],
    /// Blocks of the window in which each gauge gave every reading.
    complete: [u16; GAUGES],
    blocks: u16,
    /// Windows in a row in which each was silent against expectation.
    silent: [u8; GAUGES],
    fault: [Fault; GAUGES],
}

impl GaugeHealth {
    /// Takes the innovations of the gauges in a block, by the primary hypothesis.
    ///
    /// True when a gauge has just fallen silent.
    pub fn update(
        &mut self,
        innovations: &[BlockInnovation; GAUGES],
        block: &HarmonicBlock,
        gauges: &[GaugeModel; GAUGES],
    ) -> bool {
        let readings = (BASIS - 1) as f32 / f32::from(block.count.max(1));
        for g in 0..GAUGES {
            if !block.complete[g] {
                continue;
            }
            let noise = gauges[g].noise_std * gauges[g].noise_std * readings;
            let (read, expected) = innovations[g].local;
            self.sums[g].0 += read * read / noise;
            self.sums[g].1 += expected * expected / noise;
            self.complete[g] = self.complete[g].saturating_add(1);
        }
        self.blocks = self.blocks.saturating_add(1);
        if self.blocks < WINDOW {
            return false;
        }
        let mut fell_silent = false;
        for g in 0..GAUGES {
            let count = f32::from(self.complete[g].max(1));
            let (read, expected) = (self.sums[g].0 / count, self.sums[g].1 / count);
            let missed = self.complete[g] == WINDOW && read < DEAD_RATIO && expected > EXPECTED;
            self.silent[g] = if missed {
                self.silent[g].saturating_add(1)
            } else {
                0
            };
            if read > ALIVE_RATIO {
                self.fault[g] = Fault::None;
            } else if self.silent[g] >= PATIENCE && self.fault[g].is_none() {
                self.fault[g] = Fault::Stuck;
                fell_silent = true;
            }
        }
        self.sums = Default::default();
        self.complete = Default::default();
        self.blocks = 0;
        fell_silent
    }

    /// The fault of a gauge: `Stuck` or none.
    pub fn fault(&self, g: usize) -> Fault {
        self.fault[g % GAUGES]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blocks until a gauge that reads and is expected at these multiples of its noise is named;
    /// 200 at most.
    fn named_after(read: f32, expected: f32) -> Option<usize> {
        let gauges = [0; GAUGES].map(|_| GaugeModel::plain());
        let block = HarmonicBlock {
            count: 20,
            complete: [true; GAUGES],
            ..HarmonicBlock::default()
        };
        // Six readings of noise in 20 samples.
        let noise = 0.8 * libm::sqrtf(6.0 / 20.0);
        let mut innovations = [BlockInnovation::default(); GAUGES];
        innovations[3].local = (read * noise, expected * noise);
        let mut health = GaugeHealth::default();
        (1..=200).find(|_| health.update(&innovations, &block, &gauges))
    }

    #[test]
    fn silence_names_a_gauge_only_where_it_should_be_heard() {
        assert_eq!(named_after(1.0, 10.0), Some(50));
        assert_eq!(named_after(1.0, 1.5), None);
        assert_eq!(named_after(1.5, 10.0), None);
    }
}
