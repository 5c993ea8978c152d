//! Chooses between two sensitivity maps of a gauge by two-fold cross-validation over carrier turns:
//! the described map, shifted and widened to fit (placed), or a map fitted to readings (measured).

use crate::calibrate::Patch;
use crate::calibrate::channel_moments::Moments;
use crate::calibrate::map_placement::{Placement, fine};
use crate::calibrate::surface_fit::Surface;

/// Which sensitivity the calibrated description gets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MapSource {
    /// The described map, moved and spread over the patch of candidates.
    Placed,
    /// The surface that was fitted to the readings.
    Measured,
    /// Of each gauge the one with the smaller error on turns that it was not fitted to.
    Best,
}

impl MapSource {
    /// What `--maps` calls it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Placed => "placed",
            Self::Measured => "measured",
            Self::Best => "best",
        }
    }
}

/// The source of the map with the smaller squared error in two-fold cross-validation: fitted to the
/// even turns of the carrier and evaluated on the odd ones, and the other way round.
///
/// The placed map has four parameters, the measured one up to 512: where turns are few or do not vary the
/// torque at each angle, the measured one predicts worse, or cannot be fitted at all.
///
/// Source: Stone 1974, Cross-validatory choice and assessment of statistical predictions.
pub(super) fn best(
    halves: &[Moments; 2],
    map: &[f64],
    patch: &Patch,
    described_offset: f64,
    patch_rad: f64,
) -> MapSource {
    let (mut placed, mut measured) = (0.0, 0.0);
    for (fitted, other) in [(&halves[0], &halves[1]), (&halves[1], &halves[0])] {
        if fitted.total().n == 0.0 {
            return MapSource::Placed;
        }
        let Some(surface) = Surface::fit(fitted, map.len() > 1) else {
            return MapSource::Placed;
        };
        let Some(placement) = Placement::fit(fitted, map, patch, described_offset, patch_rad)
        else {
            return MapSource::Measured;
        };
        placed += squared_error(other, placement.offset, &placement.map);
        measured += squared_error(other, surface.offset, &surface.map);
    }
    if measured < placed {
        MapSource::Measured
    } else {
        MapSource::Placed
    }
}

/// Sum of the squared errors of `offset + map s`.
fn squared_error(moments: &Moments, offset: f64, map: &[f64]) -> f64 {
    let offset = offset - moments.origin();
    (moments.bins().iter().zip(fine(map, 0.0)))
        .map(|(bin, m)| bin.squared_error(offset, m))
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;
    use std::f64::consts::TAU;

    /// Readings of a gauge whose map is 1 + 0.3 cos(3 angle) where 1 + `described` cos(3 angle) is
    /// described, noise 0.05, over `turns` turns of 400 samples each, and how it is described.
    fn chosen(described: f64, turns: u32, seed: u64) -> MapSource {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let map: Vec<f64> = (0..360)
            .map(|i| 1.0 + described * (3.0 * TAU * f64::from(i) / 360.0).cos())
            .collect();
        let mut halves = [Moments::default(), Moments::default()];
        for k in 0..400 * turns {
            let angle = TAU * f64::from(k) / 400.0;
            let torque = 0.6 + 0.4 * (0.37 * angle).sin();
            let noise: f64 = rng.sample(StandardNormal);
            let y = (1.0 + 0.3 * (3.0 * angle).cos()) * torque + 0.05 * noise;
            halves[(k / 400) as usize % 2].push(angle, torque, y);
        }
        best(&halves, &map, &Vec::new(), 0.0, 0.1)
    }

    #[test]
    fn a_wrong_map_is_replaced_and_a_right_one_kept() {
        for seed in 1..=5 {
            assert_eq!(chosen(0.1, 20, seed), MapSource::Measured, "seed {seed}");
            assert_eq!(chosen(0.3, 20, seed), MapSource::Placed, "seed {seed}");
            assert_eq!(chosen(0.3, 2, seed), MapSource::Placed, "seed {seed}");
            assert_eq!(
                chosen(0.1, 1, seed),
                MapSource::Placed,
                "a single turn has no other"
            );
        }
    }
}
