//! Estimator design for gearboxes and other torsional drivetrains: torsional model, process noise,
//! steady gains, model image. This file lists the modules and re-exports their public items.

mod channel_tables;
mod consistency_parameters;
mod gauge_zeros;
mod load_signals;
mod model_image;
mod operating_point;
mod process_noise;
mod steady_gains;
mod torsional_model;

pub use crate::gearbox::model_image::image;
pub use crate::gearbox::operating_point::OperatingPoint;
pub use crate::gearbox::process_noise::{operating_points, process_noise};
pub use crate::gearbox::steady_gains::{SteadyTable, steady_gains};
pub use crate::gearbox::torsional_model::Torsion;
