//! Writes the tables of a torsional drivetrain into a draft description: two inertias and a shaft,
//! marked to be filled in; gauges, encoders, speeds and reference torques from the columns of the
//! recording; a sensor set where there are more than the estimator takes.

use super::Source;
use super::column_kind::{ClassifiedColumn, ColumnKind};
use super::sensor_tables::{channel, nominal, references as write_references};
use super::toml_text::{Text, number, quoted, rounded_up};

/// Most channels of a sensor set.
const CHANNELS: usize = loadtwin_common::io::raw::MAX_CHANNELS;

/// Most encoders of a sensor set.
const ENCODERS: usize = loadtwin_common::io::raw::MAX_ENCODERS;

/// The two inertias, until the machine's are filled in.
pub(super) const ENDS: [&str; 2] = ["input", "output"];

impl Source<'_> {
    pub(super) fn drivetrain(&self, text: &mut Text) {
        let gauges = self.of_kind(&[
            ColumnKind::Strain,
            ColumnKind::BridgeRatio,
            ColumnKind::Words,
        ]);
        let encoders = self.of_kind(&[ColumnKind::Counts, ColumnKind::Angle]);
        let torques = self.of_kind(&[ColumnKind::Torque]);
        let speeds = self.of_kind(&[ColumnKind::Speed]);
        // Without gauges a torque transducer is the sensor.
        let (sensed, references) =
            torques.split_at(usize::from(gauges.is_empty()).min(torques.len()));

        chain(text, &speeds, references);
        for (i, encoder) in encoders.iter().enumerate() {
            self.encoder(text, encoder, Some(ENDS[i.min(1)]));
        }
        self.index(text, &encoders);
        write_references(text, references, &ENDS);
        self.auxiliaries(text);
        let size = references
            .first()
            .map_or(1.0, |column| column.unit.to_si(column.largest()).abs());
        let size = if size > 0.0 { size } else { 1.0 };
        for gauge in &gauges {
            let range = if gauge.described_unit() == gauge.unit {
                gauge.half_range()
            } else {
                1.0
            };
            let sensitivity = if range > 0.0 { range / size } else { 1.0 };
            let shaft = (
                "{ shaft = \"shaft\" }",
                Some("the shaft or load whose torque strains the gauge"),
            );
            channel(text, gauge, shaft, Some((sensitivity, "Nm")));
        }
        for torque in sensed {
            let shaft = (
                "{ shaft = \"shaft\" }",
                Some("the shaft, load or drive whose torque it reads"),
            );
            let per_nm = torque.unit.from_si(1.0) - torque.unit.from_si(0.0);
            channel(text, torque, shaft, Some((per_nm, "Nm")));
        }
        for (i, speed) in speeds.iter().enumerate() {
            let senses = format!("{{ speed = {} }}", quoted(ENDS[i.min(1)]));
            let per_si = speed.unit.from_si(1.0) - speed.unit.from_si(0.0);
            channel(
                text,
                speed,
                (&senses, Some("the inertia whose speed it reads")),
                Some((per_si, "rad/s")),
            );
        }
        let channels: Vec<&ClassifiedColumn> = (gauges.iter().chain(sensed).chain(&speeds))
            .copied()
            .collect();
        sensor_set(text, &channels, &encoders);
    }
}

/// Two inertias, the shaft between them and their loads, for the most part to be filled in.
pub(super) fn chain(
    text: &mut Text,
    speeds: &[&ClassifiedColumn],
    references: &[&ClassifiedColumn],
) {
    text.table("[drivetrain]");
    let speed = speeds
        .first()
        .map(|column| column.unit.to_si(column.largest()).abs());
    let speed = speed.filter(|speed| *speed > 0.0).map(rounded_up);
    text.fill_in(
        "nominal_speed_rad_s",
        speed.unwrap_or_else(|| "100".into()),
        "the nominal speed of the main shaft (rad/s)",
    );
    for (i, name) in ENDS.iter().enumerate() {
        text.table("[[drivetrain.inertia]]");
        text.set("name", quoted(name));
        text.fill_in("moment_kg_m2", "1", "the moment of inertia (kg m2)");
        if i == 1 {
            text.fill_in(
                "speed_ratio",
                "1",
                "turns per turn of the first inertia, with the sign",
            );
        }
        text.fill_in(
            "drag_nm_s_per_rad",
            "0",
            "the viscous drag to the housing (N m s/rad)",
        );
    }
    text.table("[[drivetrain.shaft]]");
    text.set("name", "\"shaft\"");
    // With the inertias above, a torsional mode of 22 Hz.
    text.fill_in(
        "stiffness_nm_per_rad",
        "10000",
        "the torsional stiffness between the two inertias (N m/rad)",
    );
    text.fill_in("damping_nm_s_per_rad", "1", "its damping (N m s/rad)");
    for (i, name) in ENDS.iter().enumerate() {
        text.table("[[drivetrain.load]]");
        text.set("name", quoted(name));
        text.set("inertia", quoted(name));
        let direction = ["\"drives\"", "\"brakes\""][i];
        text.fill_in(
            "direction",
            direction,
            "does a positive load drive the inertia or brake it?",
        );
        text.fill_in(
            "nominal_nm",
            nominal(references.get(i)),
            "the nominal torque (N m)",
        );
    }
}

/// The set of sensors, where there are more than an estimator takes.
fn sensor_set(text: &mut Text, channels: &[&ClassifiedColumn], encoders: &[&ClassifiedColumn]) {
    if channels.len() <= CHANNELS && encoders.len() <= ENCODERS {
        return;
    }
    let listed = |columns: &[&ClassifiedColumn], most: usize| {
        let names: Vec<_> = columns
            .iter()
            .take(most)
            .map(|column| quoted(&column.name))
            .collect();
        format!("[{}]", names.join(", "))
    };
    text.table("[[sensor_set]]");
    text.set("name", "\"first\"");
    text.fill_in(
        "channels",
        listed(channels, CHANNELS),
        format_args!(
            "the channels that are used together, at most {}",
            number(CHANNELS as f64)
        ),
    );
    if encoders.len() > ENCODERS {
        let what = "the encoders that are used together, at most 2";
        text.fill_in("encoders", listed(encoders, ENCODERS), what);
    } else {
        text.fill_in(
            "encoders",
            listed(encoders, ENCODERS),
            "the encoders that are used",
        );
    }
}
