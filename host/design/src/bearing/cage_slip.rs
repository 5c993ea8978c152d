//! Computes by which part a cage goes faster than predicted from its contacts, from the ball-pass
//! phases that were followed: block by block, and its mean on the rig.

use std::f64::consts::{PI, TAU};

use loadtwin_common::bearing::ROWS;

use crate::bearing::calibration_file::Calibration;
use crate::bearing::gauge_prediction::{Prediction, predict_readings};
use crate::bearing::phase_tracking::CalibrationBlock;
use crate::bearing::rig_calibration::Rig;
use crate::error::BuildError;

/// Part by which the cage of `row` went faster than predicted between block `at - 1` and block `at`
/// of those that were followed; none where these are not neighbours.
///
/// `rate`: of ball passing by which the blocks were gathered, over the described one.
pub fn cage_slip(
    known: &[CalibrationBlock],
    predicted: &[Prediction],
    rate: f64,
    at: usize,
    row: usize,
) -> Option<f64> {
    let before = at
        .checked_sub(1)
        .filter(|b| known[*b].number + 1 == known[at].number)?;
    // Phases in the middle of both blocks.
    let half = |at: usize| 0.5 * f64::from(known[at].block.phase);
    let turned = known[at].phase[row] + half(at) - known[before].phase[row] - half(before);
    let expected = half(before) * predicted[before].pace[row] + half(at) * predicted[at].pace[row];
    let more = (turned - expected + PI).rem_euclid(TAU) - PI;
    let gathered = half(before) + half(at);
    Some(rate * (expected + more) / gathered - expected / gathered)
}

/// Mean slip of each cage in the blocks of a calibration; 0 where none could be followed.
///
/// # Errors
/// When the description does not make a model.
pub(crate) fn mean_cage_slip(
    rig: &Rig<'_>,
    known: &[CalibrationBlock],
    calibration: &Calibration,
) -> Result<[f64; ROWS], BuildError> {
    let predicted = predict_readings(rig, known, calibration)?;
    Ok(std::array::from_fn(|row| {
        let slips = (0..known.len())
            .filter_map(|at| cage_slip(known, &predicted, 1.0, at, row))
            .filter(|slip| slip.is_finite());
        let (sum, n) = slips.fold((0.0, 0.0), |(sum, n), slip| (sum + slip, n + 1.0));
        sum / f64::max(n, 1.0)
    }))
}
