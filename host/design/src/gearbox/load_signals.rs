//! Load signals of a drivetrain in its model image: name, full scale on the bus, and the largest
//! standard deviation of a valid estimate.

use heapless::Vec as FixedVec;
use loadtwin_common::drivetrain::LOADS;
use loadtwin_common::load_signal::LoadSignal;
use loadtwin_machine::Drivetrain;

use crate::error::BuildError;

/// Load at the end of the scale on the bus, in nominal loads.
const FULL_SCALE: f64 = 4.0;

/// Standard deviation at which an estimate is no longer valid, in nominal loads.
const VALID_STD: f64 = 0.3;

/// The signal of each load, scaled by its nominal value.
///
/// # Errors
/// When a name is longer than the image holds.
pub(super) fn load_signals(
    drivetrain: &Drivetrain,
) -> Result<FixedVec<LoadSignal, LOADS>, BuildError> {
    drivetrain
        .loads
        .iter()
        .map(|load| {
            Ok(LoadSignal {
                name: load
                    .name
                    .as_str()
                    .try_into()
                    .map_err(|_| BuildError::TooLarge("a load's name"))?,
                full_scale: (FULL_SCALE * load.nominal_nm) as f32,
                valid_std: (VALID_STD * load.nominal_nm) as f32,
            })
        })
        .collect()
}
