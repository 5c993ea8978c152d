//! Design-time model of the gearbox and other torsional drivetrains.

mod build;
mod channel_tables;
mod operating_point;
mod process_noise;
mod steady;
mod torsion;

pub use build::image;
pub use operating_point::OperatingPoint;
pub use process_noise::{operating_points, process_noise};
pub use steady::{SteadyTable, steady_gains};
pub use torsion::Torsion;
