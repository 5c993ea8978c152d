//! Design-time model of the wheel bearing: estimator and calibration.

mod answers;
pub mod baseline;
mod build;
mod calibration;
mod fit;
mod follow;
mod linear;
mod physical;
mod refine;

pub use build::{image, model};
pub use calibration::{Answer, Calibration};
pub use fit::{Rig, RigSample, calibrate};
pub use physical::Physical;
