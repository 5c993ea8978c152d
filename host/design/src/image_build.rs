//! Builds the payload of a model image for a machine and a sensor set, as `loadtwin build` and
//! `replay` use it: calls the design module of the machine's kind (drivetrain, rotor, bearing,
//! drive).

pub use crate::error::BuildError;
pub use crate::sensor_set::{Filter, Sensors};

use crate::rotor::RotorFilterDesign;
use crate::{bearing, drive, gearbox};
use loadtwin_machine::{Kind, Machine};

/// The image's payload for `machine` with `sensors`.
///
/// # Errors
/// When a file that the description names cannot be used, or the model does
/// not fit an image.
pub fn image(machine: &Machine, sensors: &Sensors) -> Result<Vec<u8>, BuildError> {
    match machine.kind() {
        Some(Kind::Drivetrain(drivetrain)) => gearbox::image(machine, drivetrain, sensors),
        Some(_) if sensors.filter == Filter::Steady => Err(BuildError::OnlyDrivetrains),
        Some(Kind::Rotor(rotor)) => RotorFilterDesign::new(machine, rotor, &sensors.channels)?
            .image(machine, rotor, sensors),
        Some(Kind::Bearing(bearing)) => bearing::image(machine, bearing, sensors),
        Some(Kind::Drive(balance)) => drive::image(machine, balance, sensors),
        None => Err(BuildError::NoEstimator(machine.path.clone())),
    }
}
