//! Design-time model of the wheel bearing: estimator and calibration.

mod answers;
pub mod baseline;
mod build;
mod calibration;
mod fit;
mod follow;
mod linear;
mod physical;
mod predicted;
mod refine;

pub use build::{calibration, image, model};
pub use calibration::{Answer, Calibration};
pub use fit::{Rig, RigSample, calibrate, fit};
pub use follow::{Known, block_samples, follow};
pub use linear::DRIFT;
pub use physical::Physical;
pub use predicted::{Predicted, predicted};
