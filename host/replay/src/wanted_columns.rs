//! Lists the columns that a replay reads for channels and encoders, with the unit in which each is
//! read and how it is resampled. Finds the references that the recording lacks.

use super::encoder_counts::Motion;
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::{Encoding, Machine, Reference};
use loadtwin_recording::{Column, Role, Unit, Wanted};

/// The columns of the channels and encoders, and how each is resampled.
pub(super) fn wanted_sensors<'a>(
    sensors: &'a Sensors,
    encodings: &[Encoding],
    motions: &[Motion],
) -> (Vec<Wanted<'a>>, Vec<Role>) {
    let mut wanted = Vec::new();
    for (channel, encoding) in sensors.channels.iter().zip(encodings) {
        wanted.push(Wanted {
            name: &channel.name,
            unit: encoding.unit(channel),
            required: true,
        });
    }
    let mut roles = vec![Role::Continuous; wanted.len()];
    for (encoder, motion) in sensors.encoders.iter().zip(motions) {
        wanted.push(Wanted {
            name: &encoder.name,
            unit: motion.unit(),
            required: true,
        });
        roles.push(match motion {
            Motion::Count => encoder.role(false),
            Motion::Angle { .. } => encoder.role(true),
            Motion::Speed { .. } => Role::Continuous,
        });
    }
    (wanted, roles)
}

/// The references without a column among those `found`; none where no reference has one, as in operation.
pub(super) fn missing_references(machine: &Machine, found: &[Column]) -> Vec<String> {
    let is_there = |reference: &&Reference| found.iter().any(|c| c.name == reference.name);
    if !machine.references.iter().any(|r| is_there(&r)) {
        return Vec::new();
    }
    let missing = machine.references.iter().filter(|r| !is_there(r));
    missing.map(|reference| reference.name.clone()).collect()
}

/// A column that a recording need not have.
pub(super) fn optional(name: &str, unit: Unit) -> Wanted<'_> {
    Wanted {
        name,
        unit,
        required: false,
    }
}
