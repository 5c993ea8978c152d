//! Design-time model of the wheel bearing: estimator and calibration.

pub mod baseline;
mod build;
mod calibration;
mod design_matrix;
mod gauge_calibration;
mod phase_tracking;
mod physical_fit;
mod physical_parameters;
mod prediction;
mod rig_fit;

pub use crate::bearing::build::{calibration, image, model};
pub use crate::bearing::calibration::{CALIBRATION, Calibration, GaugeResponse};
pub use crate::bearing::design_matrix::DRIFT_TERMS;
pub use crate::bearing::phase_tracking::{CalibrationBlock, block_samples, track_phases};
pub use crate::bearing::physical_parameters::PhysicalParameters;
pub use crate::bearing::prediction::{Prediction, predict_readings};
pub use crate::bearing::rig_fit::{Rig, RigSample, calibrate, fit};
