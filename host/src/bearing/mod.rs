//! Design-time model of the wheel bearing: estimator and calibration.

mod build;
mod calibration;
mod fit;

pub use build::{image, model};
pub use calibration::{Answer, Calibration};
pub use fit::{Rig, RigSample, calibrate};
