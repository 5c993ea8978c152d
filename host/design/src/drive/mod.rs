//! Estimator design for a drive without strain gauges: model
//! image, effects and filter noise from the balance of forces.

mod build;
mod effects;
mod noise;

pub use build::image;
