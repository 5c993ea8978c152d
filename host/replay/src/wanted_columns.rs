//! Columns that a replay reads: how the file has each channel and encoder, references that it need
//! not have, and those of them that are missing.

use super::encoder_counts::Motion;
use loadtwin_design::build::Sensors;
use loadtwin_machine::{Machine, Reference};
use loadtwin_recording::{Column, Quantity, Role, Unit, Wanted};

/// What the column of an analogue channel holds.
#[derive(Clone, Copy)]
pub(super) enum Encoding {
    /// The converter's words themselves.
    Word,
    /// The output of the channel's bridge.
    Ratio,
    /// The reading.
    Reading,
}

/// How the file has each channel, by the quantity of its column.
pub(super) fn encodings(
    sensors: &Sensors,
    quantity: impl Fn(&str) -> Option<Quantity>,
) -> Vec<Encoding> {
    sensors
        .channels
        .iter()
        .map(|channel| match quantity(&channel.name) {
            Some(Quantity::Counts) => Encoding::Word,
            Some(Quantity::BridgeRatio) if channel.bridge.is_some() => Encoding::Ratio,
            _ => Encoding::Reading,
        })
        .collect()
}

/// The columns of the channels and encoders, and how each is resampled.
pub(super) fn wanted_sensors<'a>(
    sensors: &'a Sensors,
    encodings: &[Encoding],
    motions: &[Motion],
) -> (Vec<Wanted<'a>>, Vec<Role>) {
    let mut wanted = Vec::new();
    for (channel, encoding) in sensors.channels.iter().zip(encodings) {
        let unit = match encoding {
            Encoding::Word => Unit::COUNTS,
            Encoding::Ratio => Unit::VOLT_PER_VOLT,
            Encoding::Reading => channel.unit.si(),
        };
        wanted.push(Wanted {
            name: &channel.name,
            unit,
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
