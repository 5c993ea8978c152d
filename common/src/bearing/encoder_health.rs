//! Detects a wheel encoder whose count stands still while balls pass the gauges of a bearing
//! (`EncoderHealth`): at a standstill a gauge's strain changes from sample to sample by noise alone.

use serde::{Deserialize, Serialize};

use crate::bearing::harmonic_block::HarmonicSums;
use crate::bearing::{GAUGES, GaugeModel};
use crate::io::fault::Fault;

/// Mean square change from sample to sample, over that of noise, from which balls pass a gauge. Of
/// noise it scatters by 0.4 about 1 in the 20 samples of a block.
const MOVING: f32 = 3.0;

/// Blocks in a row, 0.1 s, in which balls pass two gauges before the encoder is at fault.
const PATIENCE: u8 = 10;

/// Blocks in a row in which balls pass and the encoder stands.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct EncoderHealth {
    blocks: u8,
}

impl EncoderHealth {
    /// Takes a block in which the encoder stands.
    pub fn update(&mut self, sums: &HarmonicSums, gauges: &[GaugeModel; GAUGES]) {
        let moves = |(g, gauge): &(usize, &GaugeModel)| {
            let noise = 2.0 * gauge.noise_std * gauge.noise_std;
            sums.mean_square_change(*g) > MOVING * noise
        };
        let moving = gauges.iter().enumerate().filter(moves).count();
        self.blocks = if moving > 1 {
            self.blocks.saturating_add(1)
        } else {
            0
        };
    }

    /// The fault of the encoder: `Stuck` or none.
    pub fn fault(self) -> Fault {
        if self.blocks > PATIENCE {
            Fault::Stuck
        } else {
            Fault::None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blocks until an encoder that stands is at fault, 50 at most, where the strain of the first
    /// `gauges` alternates by this many standard deviations of noise.
    fn named_after(gauges: usize, amplitude: f32) -> Option<usize> {
        let models = [0; GAUGES].map(|_| GaugeModel::plain());
        let mut sums = HarmonicSums::default();
        for k in 0..20 {
            let strain = if k % 2 == 0 { 0.8 } else { -0.8 } * amplitude;
            let mut readings = [Some(100.0); GAUGES];
            readings[..gauges].fill(Some(100.0 + strain));
            sums.add(0.0, 0, &readings);
        }
        let mut health = EncoderHealth::default();
        (1..=50).find(|_| {
            health.update(&sums, &models);
            !health.fault().is_none()
        })
    }

    #[test]
    fn balls_that_pass_two_gauges_name_a_standing_encoder() {
        assert_eq!(named_after(2, 5.0), Some(11));
        assert_eq!(named_after(1, 5.0), None);
        assert_eq!(named_after(4, 0.7), None);
    }
}
