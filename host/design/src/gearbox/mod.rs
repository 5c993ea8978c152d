//! Estimator design for gearboxes and other torsional drivetrains: torsional model, process noise,
//! steady gains, model image.

mod build;
mod channel_tables;
mod consistency;
mod operating_point;
mod process_noise;
mod steady;
mod torsion;

pub use crate::gearbox::build::image;
pub use crate::gearbox::operating_point::OperatingPoint;
pub use crate::gearbox::process_noise::{operating_points, process_noise};
pub use crate::gearbox::steady::{SteadyTable, steady_gains};
pub use crate::gearbox::torsion::Torsion;
