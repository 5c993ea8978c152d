//! Predicts the strain of each gauge (mean and ball-pass harmonics, in um/m) and the ball-pass rate
//! of each row from a bearing's calibration, for blocks whose loads and phases are known.
//! `loadtwin diagnose` compares these with the readings.

use loadtwin_common::bearing::{BASIS, GAUGES, ROWS};

use crate::bearing::calibration_file::{Calibration, GaugeResponse};
use crate::bearing::design_matrix::{rows, settled};
use crate::bearing::phase_tracking::CalibrationBlock;
use crate::bearing::rig_calibration::Rig;
use crate::error::BuildError;

/// Prediction of a calibration for a block, given its loads and phases.
#[derive(Clone, Debug)]
pub struct Prediction {
    /// Strain of each gauge as independent readings, the mean first, then what goes with the
    /// balls [um/m]; 0 where a reading is missing.
    pub strain: [[f64; BASIS]; GAUGES],
    /// Rate of ball passing of each row over that at the unloaded contact angle.
    pub pace: [f64; ROWS],
}

/// Predictions of `calibration` for each block.
///
/// # Errors
/// When the description does not make a model.
pub fn predict_readings(
    rig: &Rig<'_>,
    known: &[CalibrationBlock],
    calibration: &Calibration,
) -> Result<Vec<Prediction>, BuildError> {
    let settled = settled(rig, known.iter(), &calibration.physical)?;
    let coefficients: Vec<_> = (calibration.gauge.iter())
        .map(GaugeResponse::coefficients)
        .collect();
    Ok((known.iter().zip(&settled))
        .map(|(block, (features, pace))| {
            let mut strain = [[0.0; BASIS]; GAUGES];
            let share = f64::from(block.block.count).sqrt().recip();
            for (g, (strain, x)) in strain.iter_mut().zip(&coefficients).enumerate() {
                rows(block, features, rig.passing(g), g, |row, _, k| {
                    let sum: f64 = row.iter().zip(x).map(|(row, x)| row * x).sum();
                    strain[k] = share * sum;
                });
            }
            Prediction {
                strain,
                pace: pace.map(f64::from),
            }
        })
        .collect())
}
