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

/// Names the references without a column among those `found`, with columns of nearly their name;
/// none where the recording has no reference and nothing like one, as in operation.
pub(super) fn reference_note(machine: &Machine, found: &[Column]) -> Option<String> {
    let is_there = |reference: &&Reference| found.iter().any(|c| c.name == reference.name);
    let plain = |name: &str| -> String {
        let letters = name.chars().filter(|c| c.is_alphanumeric());
        letters.flat_map(char::to_lowercase).collect()
    };
    let similar = |reference: &Reference| {
        let name = plain(&reference.name);
        found.iter().find(|column| plain(&column.name) == name)
    };
    let missing: Vec<_> = (machine.references.iter())
        .filter(|r| !is_there(r))
        .map(|reference| (reference, similar(reference)))
        .collect();
    let is_known = missing.len() < machine.references.len();
    if missing.is_empty() || !is_known && missing.iter().all(|(_, similar)| similar.is_none()) {
        return None;
    }
    let names = missing.iter().map(|(reference, similar)| match similar {
        Some(column) => format!(
            "`{}` (`column = {:?}` under [recording.channels] would read `{}` as that)",
            reference.name, column.name, column.name
        ),
        None => format!("`{}`", reference.name),
    });
    Some(format!(
        "no column {}: the loads of these references have no error figure",
        names.collect::<Vec<_>>().join(", ")
    ))
}

/// A column that a recording need not have.
pub(super) fn optional(name: &str, unit: Unit) -> Wanted<'_> {
    Wanted {
        name,
        unit,
        required: false,
    }
}
