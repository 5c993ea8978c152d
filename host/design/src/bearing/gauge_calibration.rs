//! Fits the strain response of each gauge to calibration blocks by linear least squares, and splits
//! the residuals into noise and model error (`fit_gauges`). `uncertainty` adds cluster-robust
//! standard deviations of the coefficients. Both write into a `Calibration`.

use faer::Mat;
use faer::linalg::solvers::Solve;
use loadtwin_common::bearing::contact::Features;
use loadtwin_common::bearing::{FEATURES, GAUGES, LOADS, ROWS};
use rayon::prelude::*;

use crate::bearing::calibration_file::{Calibration, Local};
use crate::bearing::design_matrix::{
    BULK_TERMS, COEFFICIENTS, DRIFT_TERMS, Normal, features, normal, rows,
};
use crate::bearing::phase_tracking::CalibrationBlock;
use crate::bearing::rig_calibration::{ERROR_CORRELATION_FACTOR, Rig};
use crate::error::BuildError;

/// Stretches of the recording between which errors count as independent.
const SEGMENTS: usize = 40;
/// As [`ERROR_CORRELATION_FACTOR`], on the part of the error that does not grow with the strain.
const ERROR_CORRELATION_FACTOR_AT_REST: f64 = 2.0;
/// Lower bound of a gauge's noise [um/m].
const LEAST_NOISE: f64 = 0.5;

/// Fits the responses of all gauges to the blocks that were followed.
pub fn fit_gauges(
    rig: &Rig<'_>,
    known: &[CalibrationBlock],
    calibration: &mut Calibration,
) -> Result<(), BuildError> {
    let features = features(rig, known.iter(), &calibration.physical)?;
    let fits: Vec<Mat<f64>> = (0..GAUGES)
        .into_par_iter()
        .map(|g| normal(rig, known.iter(), &features, g).solve().0)
        .collect();
    for (g, x) in fits.iter().enumerate() {
        let answer = &mut calibration.gauge[g];
        answer.name.clone_from(&rig.bearing.gauges[g].name);
        answer.offset = x[(0, 0)];
        place(
            &mut |i| x[(i, 0)],
            &mut answer.bulk_load,
            &mut answer.bulk_feature,
            &mut answer.local,
        );
        let passing = rig.passing(g);
        let left = Left::of(known, &features, passing, g, x);
        answer.bulk_error = left.bulk;
        // What the description does not expect of the channel is an error of the model too.
        answer.noise_std = described_noise(rig, g).min(left.noise);
        let modelled = left.noise * left.noise - answer.noise_std * answer.noise_std;
        answer.resting_error = ERROR_CORRELATION_FACTOR_AT_REST * modelled.sqrt();
        answer.model_error = ERROR_CORRELATION_FACTOR * left.relative;
    }
    Ok(())
}

/// Noise of a sample that the description expects of gauge g, its quantisation among it [um/m].
fn described_noise(rig: &Rig<'_>, g: usize) -> f64 {
    let channel = &rig.sensors.channels[g];
    let step = channel.lsb_si();
    1e6 * (channel.to_si(channel.noise_std).powi(2) + step * step / 12.0).sqrt()
}

/// Residuals of a fit to a gauge's strain.
struct Left {
    /// Standard deviation of the bulk strain [um/m].
    bulk: f64,
    /// Of the local strain at rest [um/m], and the part that goes with the strain.
    noise: f64,
    relative: f64,
}

impl Left {
    /// `e^2 = noise^2 + relative^2 |C|^2` over the blocks, large strains counting less.
    fn of(
        known: &[CalibrationBlock],
        features: &[Features],
        passing: f64,
        g: usize,
        x: &Mat<f64>,
    ) -> Self {
        let mut bulk = (0.0, 1e-9);
        let mut q = [1e-9, 0.0, 1e-9, 0.0, 0.0];
        for (block, features) in known.iter().zip(features) {
            let (mut square, mut error, mut count) = (0.0, 0.0, 0.0);
            rows(block, features, passing, g, |row, y, k| {
                let predicted: f64 = row.iter().enumerate().map(|(i, r)| r * x[(i, 0)]).sum();
                let left = y - predicted;
                if k == 0 {
                    bulk.0 += left * left / f64::from(block.block.count);
                    bulk.1 += 1.0;
                } else {
                    square += predicted * predicted;
                    error += left * left;
                    count += 1.0;
                }
            });
            if count > 0.0 {
                let (strain, error) = (2.0 * square / f64::from(block.block.count), error / count);
                let w = 1.0 / (1.0 + 0.01 * strain).powi(2);
                for (sum, value) in
                    q.iter_mut()
                        .zip([1.0, strain, strain * strain, error, strain * error])
                {
                    *sum += w * value;
                }
            }
        }
        let determinant = q[0] * q[2] - q[1] * q[1];
        let mut noise = (q[3] * q[2] - q[4] * q[1]) / determinant;
        let mut relative = (q[0] * q[4] - q[1] * q[3]) / determinant;
        // All of it may go with the strain; a converter's noise remains.
        if noise.is_nan() || noise <= LEAST_NOISE * LEAST_NOISE {
            noise = LEAST_NOISE * LEAST_NOISE;
            relative = q[4] / q[2];
        }
        Self {
            bulk: f64::sqrt(bulk.0 / bulk.1),
            noise: noise.sqrt(),
            relative: relative.max(1e-4).sqrt(),
        }
    }
}

/// Spreads the coefficients over the fields of a response.
fn place(
    at: &mut dyn FnMut(usize) -> f64,
    bulk_load: &mut [f64; LOADS],
    bulk_feature: &mut [[f64; FEATURES]; ROWS],
    local: &mut Local,
) {
    for (i, slot) in bulk_load.iter_mut().enumerate() {
        *slot = at(DRIFT_TERMS + i);
    }
    for (i, slot) in bulk_feature.iter_mut().flatten().enumerate() {
        *slot = at(DRIFT_TERMS + LOADS + i);
    }
    for (i, slot) in local.iter_mut().flatten().flatten().flatten().enumerate() {
        *slot = at(BULK_TERMS + i);
    }
}

/// Standard deviations of the coefficients.
///
/// `(X'X)^-1 (sum_c g_c g_c') (X'X)^-1`, `g_c` the gradient of stretch c of the recording:
/// errors within a stretch may go together as they like.
pub fn uncertainty(
    rig: &Rig<'_>,
    known: &[CalibrationBlock],
    calibration: &mut Calibration,
) -> Result<(), BuildError> {
    let all = features(rig, known.iter(), &calibration.physical)?;
    let length = known.len().div_ceil(SEGMENTS);
    let deviations: Vec<Vec<f64>> = (0..GAUGES)
        .into_par_iter()
        .map(|g| {
            let parts: Vec<Normal> = known
                .chunks(length)
                .zip(all.chunks(length))
                .map(|(known, features)| normal(rig, known.iter(), features, g))
                .collect();
            let mut total = parts[0].clone();
            for part in &parts[1..] {
                total.gram += &part.gram;
                total.right += &part.right;
            }
            let Some(factor) = total.factor() else {
                return vec![f64::INFINITY; COEFFICIENTS];
            };
            let x = factor.solve(&total.right);
            let mut squares = vec![0.0; COEFFICIENTS];
            for part in &parts {
                let moved = factor.solve(&part.right - &part.gram * &x);
                for (i, square) in squares.iter_mut().enumerate() {
                    *square += moved[(i, 0)] * moved[(i, 0)];
                }
            }
            squares.into_iter().map(f64::sqrt).collect()
        })
        .collect();
    for (answer, std) in calibration.gauge.iter_mut().zip(&deviations) {
        place(
            &mut |i| std[i],
            &mut answer.bulk_load_std,
            &mut answer.bulk_feature_std,
            &mut answer.local_std,
        );
    }
    Ok(())
}
