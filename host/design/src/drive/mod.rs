//! Drives: from the balance of forces and its effects to the estimator.

mod build;
mod effects;
mod noise;

pub use build::image;
