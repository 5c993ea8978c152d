//! Fits the deviations of a bearing's physical parameters from its description to calibration
//! blocks: maximum a posteriori, by Gauss-Newton steps with the coefficients of the gauges
//! eliminated. Writes parameters and standard deviations into a `Calibration`.

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};
use loadtwin_common::bearing::GAUGES;
use loadtwin_common::bearing::contact::Features;
use rayon::prelude::*;

use crate::bearing::calibration_file::Calibration;
use crate::bearing::design_matrix::{COEFFICIENTS, features, normal, rows, weight};
use crate::bearing::phase_tracking::CalibrationBlock;
use crate::bearing::physical_parameters::{PARAMETERS, PhysicalParameters};
use crate::bearing::rig_calibration::{ERROR_CORRELATION_FACTOR, Rig};
use crate::error::BuildError;

/// One block in this many is used.
const THINNED: usize = 4;
/// Steps of the Gauss-Newton method.
const STEPS: usize = 3;

/// Most times that a step is halved which does not lower the cost.
const HALVINGS: usize = 3;
/// Difference over which features are differentiated, in prior standard deviations.
const DIFFERENCE: f64 = 0.2;

type Parameters = [f64; PARAMETERS];

/// Fits the deviations of the bearing from its description.
///
/// Minimises `sum_g rows_g ln(left_g / rows_g) / ERROR_CORRELATION_FACTOR^2 + |p|^2`, `left_g` the residual
/// sum of squares of the linear fit of gauge g, `p` the parameters in units of their prior standard
/// deviations, by Gauss-Newton steps on all coefficients and parameters at once.
pub fn refine(
    rig: &Rig<'_>,
    known: &[CalibrationBlock],
    calibration: &mut Calibration,
) -> Result<(), BuildError> {
    let known: Vec<&CalibrationBlock> = known.iter().step_by(THINNED).collect();
    let mut at = calibration.physical.normalised();
    let mut here = features_at(rig, &known, &at)?;
    let mut cost = cost_of(rig, &known, &here, &at);
    for _ in 0..STEPS {
        let moved = (0..PARAMETERS)
            .into_par_iter()
            .map(|k| {
                let mut moved = at;
                moved[k] += DIFFERENCE;
                features_at(rig, &known, &moved)
            })
            .collect::<Result<Vec<_>, _>>()?;
        let parts: Vec<(Mat<f64>, Mat<f64>)> = (0..GAUGES)
            .into_par_iter()
            .map(|g| reduced(rig, &known, &here, &moved, g))
            .collect();
        let mut curvature = Mat::<f64>::identity(PARAMETERS, PARAMETERS);
        let mut slope = Mat::from_fn(PARAMETERS, 1, |k, _| -at[k]);
        for (gram, right) in &parts {
            curvature += gram;
            slope += right;
        }
        let Ok(factor) = curvature.llt(Side::Lower) else {
            break;
        };
        let covariance = factor.solve(Mat::<f64>::identity(PARAMETERS, PARAMETERS));
        let std: Parameters = std::array::from_fn(|k| covariance[(k, k)].sqrt());
        calibration.physical_std = PhysicalParameters::from_normalised(&std);
        let mut step = factor.solve(&slope);
        let mut better = false;
        for _ in 0..=HALVINGS {
            let next: Parameters = std::array::from_fn(|k| at[k] + step[(k, 0)]);
            if let Ok(there) = features_at(rig, &known, &next) {
                let lower = cost_of(rig, &known, &there, &next);
                if lower < cost {
                    (at, here, cost, better) = (next, there, lower, true);
                    break;
                }
            }
            step *= faer::Scale(0.5);
        }
        if !better {
            break;
        }
    }
    calibration.physical = PhysicalParameters::from_normalised(&at);
    Ok(())
}

fn features_at(
    rig: &Rig<'_>,
    known: &[&CalibrationBlock],
    at: &Parameters,
) -> Result<Vec<Features>, BuildError> {
    let physical = PhysicalParameters::from_normalised(at);
    features(rig, known.iter().copied(), &physical)
}

fn cost_of(
    rig: &Rig<'_>,
    known: &[&CalibrationBlock],
    features: &[Features],
    at: &Parameters,
) -> f64 {
    let left: f64 = (0..GAUGES)
        .into_par_iter()
        .map(|g| {
            let normal = normal(rig, known.iter().copied(), features, g);
            normal.rows * (normal.solve().1 / normal.rows).ln()
        })
        .sum();
    left / (ERROR_CORRELATION_FACTOR * ERROR_CORRELATION_FACTOR)
        + at.iter().map(|part| part * part).sum::<f64>()
}

/// Normal equations of the parameters by one gauge, its coefficients eliminated.
fn reduced(
    rig: &Rig<'_>,
    known: &[&CalibrationBlock],
    here: &[Features],
    moved: &[Vec<Features>],
    g: usize,
) -> (Mat<f64>, Mat<f64>) {
    let normal = normal(rig, known.iter().copied(), here, g);
    let (x, left) = normal.solve();
    let passing = rig.passing(g);
    let mut gram = Mat::<f64>::zeros(PARAMETERS, PARAMETERS);
    let mut cross = Mat::<f64>::zeros(COEFFICIENTS, PARAMETERS);
    let mut right = Mat::<f64>::zeros(PARAMETERS, 1);
    let predicted = |row: &[f64; COEFFICIENTS]| -> f64 {
        row.iter().enumerate().map(|(i, r)| r * x[(i, 0)]).sum()
    };
    for (i, block) in known.iter().enumerate() {
        let mut slopes = Vec::new();
        for there in moved {
            let mut values = Vec::new();
            rows(block, &there[i], passing, g, |row, _, _| {
                values.push(predicted(row));
            });
            slopes.push(values);
        }
        let mut reading = 0;
        rows(block, &here[i], passing, g, |row, y, k| {
            let w = weight(block, 1.0, k);
            let now = predicted(row);
            let slope: Parameters =
                std::array::from_fn(|p| (slopes[p][reading] - now) / DIFFERENCE);
            for p in 0..PARAMETERS {
                let scaled = w * slope[p];
                right[(p, 0)] += scaled * (y - now);
                for q in 0..PARAMETERS {
                    gram[(q, p)] += scaled * slope[q];
                }
                for (c, value) in row.iter().enumerate() {
                    cross[(c, p)] += scaled * value;
                }
            }
            reading += 1;
        });
    }
    let scale = normal.rows / (left * ERROR_CORRELATION_FACTOR * ERROR_CORRELATION_FACTOR);
    if let Some(factor) = normal.factor() {
        gram -= cross.transpose() * factor.solve(&cross);
    }
    (gram * faer::Scale(scale), right * faer::Scale(scale))
}
