//! Updates a gauge's sensitivity map: chooses the node of its patch, or the shift and spread of the
//! described map, with the least mean absolute error to the readings. Offset and gain are fitted by
//! least squares.

use std::f64::consts::TAU;

use crate::calibrate::channel_moments::{BINS, Moments};
use loadtwin_machine::{MAP_ENTRIES, resampled};

/// Bins over which simulated and measured readings are compared.
const COMPARED: usize = 512;

/// Widths by which a peak may be spread at first [rad].
const SPREADS: [f64; 7] = [0.0, 0.01, 0.02, 0.04, 0.08, 0.12, 0.2];

/// A gauge's model after the update.
#[derive(Clone, Debug)]
pub struct Placement {
    /// Reading at zero load (SI).
    pub offset: f64,
    /// Factor on the described sensitivity.
    pub gain: f64,
    /// How far the gauge sits ahead of where it was said to be (rad).
    pub shift_rad: f64,
    /// Width over which its peaks are spread (rad): away from the load concentration.
    pub spread_rad: f64,
    /// The node of its patch that fits best, where the machine gives maps of such nodes.
    pub node: Option<String>,
    /// Mean absolute error over the carrier angle with the described model (SI).
    pub mae_before: f64,
    /// The same after the update.
    pub mae: f64,
    /// Sensitivity over the carrier angle after the update (reading in SI per unit sensed).
    pub map: Vec<f64>,
}

impl Placement {
    /// The candidate with the least mean absolute error of simulated against
    /// measured readings over the carrier angle.
    ///
    /// Candidates are the maps of the nodes in the gauge's `patch`. Without these
    /// they are the described `map` turned by up to `patch_rad` either way and
    /// spread over neighbouring angles, which lowers a peak and keeps its mean, as
    /// nodes do that lie further from the mid-plane of the ring gear. Offset and
    /// gain are fitted for each one. None where they are not separable.
    ///
    /// Source: Bosmans et al. 2023, section 4.2.
    pub fn fit(
        moments: &Moments,
        map: &[f64],
        patch: &[(String, Vec<f64>)],
        offset: f64,
        patch_rad: f64,
    ) -> Option<Self> {
        let mae_before = absolute_error(moments, offset - moments.origin(), &fine(map, 0.0));
        if !patch.is_empty() {
            return Self::among(moments, patch, mae_before);
        }
        if map.len() == 1 {
            let (offset, gain, mae) = affine(moments, &fine(map, 0.0))?;
            return Some(Self {
                offset: offset + moments.origin(),
                gain,
                shift_rad: 0.0,
                spread_rad: 0.0,
                node: None,
                mae_before,
                mae,
                map: vec![map[0] * gain],
            });
        }
        let described = resampled(map, MAP_ENTRIES);
        let shifts: Vec<f64> = (-10..=10)
            .map(|i| patch_rad * f64::from(i) / 10.0)
            .collect();
        let mut best = search(moments, &described, &shifts, &SPREADS)?;
        let (mut shift_step, mut spread_step) = (patch_rad / 10.0, 0.5 * best.spread_rad.max(0.01));
        for _ in 0..4 {
            shift_step *= 0.4;
            spread_step *= 0.5;
            let around = |centre: f64, step: f64| {
                (-2..=2)
                    .map(|i| centre + step * f64::from(i))
                    .collect::<Vec<_>>()
            };
            let mut spreads = around(best.spread_rad, spread_step);
            spreads.retain(|spread| *spread >= 0.0);
            best = search(
                moments,
                &described,
                &around(best.shift_rad, shift_step),
                &spreads,
            )?;
        }
        let moved = fine(&spread(&described, best.spread_rad), best.shift_rad);
        Some(Self {
            offset: best.offset + moments.origin(),
            mae_before,
            // The value at each entry is the mean of the two fine bins around it.
            map: (0..MAP_ENTRIES)
                .map(|i| {
                    let k = i * BINS / MAP_ENTRIES;
                    0.5 * best.gain * (moved[(k + BINS - 1) % BINS] + moved[k])
                })
                .collect(),
            ..best
        })
    }

    /// The node of `patch` with the least mean absolute error.
    fn among(moments: &Moments, patch: &[(String, Vec<f64>)], mae_before: f64) -> Option<Self> {
        patch
            .iter()
            .filter_map(|(node, map)| {
                let map = resampled(map, MAP_ENTRIES);
                let (offset, gain, mae) = affine(moments, &fine(&map, 0.0))?;
                Some(Self {
                    offset: offset + moments.origin(),
                    gain,
                    shift_rad: 0.0,
                    spread_rad: 0.0,
                    node: Some(node.clone()),
                    mae_before,
                    mae,
                    map: map.iter().map(|m| gain * m).collect(),
                })
            })
            .min_by(|a, b| a.mae.total_cmp(&b.mae))
    }
}

/// The best of all combinations of `shifts` and `spreads`; its map is left empty.
fn search(moments: &Moments, map: &[f64], shifts: &[f64], spreads: &[f64]) -> Option<Placement> {
    spreads
        .iter()
        .flat_map(|&spread_rad| {
            let spread = spread(map, spread_rad);
            shifts.iter().filter_map(move |&shift_rad| {
                let (offset, gain, mae) = affine(moments, &fine(&spread, shift_rad))?;
                let map = Vec::new();
                Some(Placement {
                    offset,
                    gain,
                    shift_rad,
                    spread_rad,
                    node: None,
                    mae_before: mae,
                    mae,
                    map,
                })
            })
        })
        .min_by(|a, b| a.mae.total_cmp(&b.mae))
}

/// `map` at the middle of each fine bin, turned by `shift` (rad).
pub fn fine(map: &[f64], shift: f64) -> Vec<f64> {
    let n = map.len();
    if n == 1 {
        return vec![map[0]; BINS];
    }
    let turned = (shift / TAU).rem_euclid(1.0) * n as f64;
    (0..BINS)
        .map(|k| {
            let position = (k as f64 + 0.5) * n as f64 / BINS as f64 - turned + n as f64;
            let (left, u) = (position as usize, position.fract());
            map[left % n] * (1.0 - u) + map[(left + 1) % n] * u
        })
        .collect()
}

/// `map` convolved with a normal distribution of standard deviation `width` [rad].
fn spread(map: &[f64], width: f64) -> Vec<f64> {
    let n = map.len();
    let step = TAU / n as f64;
    if width < 0.1 * step {
        return map.to_vec();
    }
    let reach = ((4.0 * width / step).ceil() as usize).min(n / 2 - 1);
    let weights: Vec<f64> = (0..=reach)
        .map(|i| (-0.5 * (i as f64 * step / width).powi(2)).exp())
        .collect();
    let sum = 2.0 * weights.iter().sum::<f64>() - weights[0];
    (0..n)
        .map(|i| {
            let sides = weights.iter().enumerate().skip(1);
            let around: f64 = sides
                .map(|(k, w)| w * (map[(i + k) % n] + map[(i + n - k) % n]))
                .sum();
            (around + weights[0] * map[i]) / sum
        })
        .collect()
}

/// Offset and gain by least squares, and the mean absolute error over the angle.
fn affine(moments: &Moments, map: &[f64]) -> Option<(f64, f64, f64)> {
    let (mut ms, mut mms, mut my) = (0.0, 0.0, 0.0);
    for (bin, m) in moments.bins().iter().zip(map) {
        ms += m * bin.s;
        mms += m * m * bin.ss;
        my += m * bin.sy;
    }
    let total = moments.total();
    let determinant = total.n * mms - ms * ms;
    if determinant.is_nan() || determinant <= 1e-6 * total.n * mms {
        return None;
    }
    let gain = (total.n * my - ms * total.y) / determinant;
    let offset = (total.y - gain * ms) / total.n;
    let scaled: Vec<f64> = map.iter().map(|m| gain * m).collect();
    Some((offset, gain, absolute_error(moments, offset, &scaled)))
}

/// Mean over the carrier angle of `|mean measured - simulated|`; `offset`
/// relative to the origin of the moments.
fn absolute_error(moments: &Moments, offset: f64, map: &[f64]) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    let per_bin = BINS / COMPARED;
    for (bins, map) in moments.bins().chunks(per_bin).zip(map.chunks(per_bin)) {
        let n: f64 = bins.iter().map(|bin| bin.n).sum();
        if n > 0.0 {
            let error: f64 = bins
                .iter()
                .zip(map)
                .map(|(bin, m)| bin.error(offset, *m))
                .sum();
            sum += (error / n).abs();
            count += 1;
        }
    }
    sum / f64::from(count.max(1))
}
