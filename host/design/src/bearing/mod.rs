//! Estimator design for a wheel bearing: calibration from rig recordings, model image, and the
//! published algorithms to compare with. This file lists the modules and re-exports their public
//! items.

pub mod baseline;
mod cage_slip;
mod calibration_file;
mod design_matrix;
mod gauge_calibration;
mod gauge_prediction;
mod model_image;
mod phase_tracking;
mod physical_fit;
mod physical_parameters;
mod rig_calibration;

pub use crate::bearing::cage_slip::cage_slip;
pub use crate::bearing::calibration_file::{CALIBRATION, Calibration, GaugeResponse};
pub use crate::bearing::design_matrix::DRIFT_TERMS;
pub use crate::bearing::gauge_prediction::{Prediction, predict_readings};
pub use crate::bearing::model_image::{calibration, image, model};
pub use crate::bearing::phase_tracking::{CalibrationBlock, block_samples, track_phases};
pub use crate::bearing::physical_parameters::PhysicalParameters;
pub use crate::bearing::rig_calibration::{Rig, RigSample, calibrate, fit};
