//! Computes the entries of a drivetrain's loads in the model image: name, full scale on the bus,
//! largest standard deviation of a valid estimate, and the error band that was measured with the
//! sensor set.

use heapless::Vec as FixedVec;
use loadtwin_common::drivetrain::{ErrorBand, LOADS};
use loadtwin_common::load_signal::LoadSignal;
use loadtwin_machine::Drivetrain;

use crate::error::BuildError;
use crate::sensor_set::Sensors;

/// Load at the end of the scale on the bus, in nominal loads: room for overload, at steps of 3e-5
/// nominal.
const FULL_SCALE: f64 = 4.0;

/// Standard deviation at which an estimate is no longer valid, in nominal loads: the band of twice
/// it is then 60 % of nominal.
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

/// The measured error of each load with `sensors`; as the filter states it where none was measured.
pub(super) fn error_bands(drivetrain: &Drivetrain, sensors: &Sensors) -> [ErrorBand; LOADS] {
    let mut bands = [ErrorBand::default(); LOADS];
    for (band, load) in bands.iter_mut().zip(&drivetrain.loads) {
        if let Some(measured) = load.error_bands.get(&sensors.name) {
            *band = ErrorBand {
                error_over_std: measured.error_over_std as f32,
                variance: (measured.std_nm / load.nominal_nm).powi(2) as f32,
                movement: measured.movement as f32,
            };
        }
    }
    bands
}
