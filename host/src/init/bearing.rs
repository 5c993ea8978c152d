//! Writes the tables of a wheel bearing with four gauges into a draft description: values of a
//! passenger car's hub, marked to be filled in; gauges, encoder, references and load ranges from
//! the columns of the recording.

use loadtwin_common::bearing::GAUGES;
use loadtwin_machine::BEARING_LOADS;

use super::column_kind::{ClassifiedColumn, ColumnKind};
use super::sensor_tables::{channel, references};
use super::toml_text::{Text, number, quoted};
use super::{InitError, Source};

/// Fields of a bearing with values of a wheel hub of a passenger car.
const FIELDS: [(&str, &str, &str); 9] = [
    ("balls", "13", "balls in each row"),
    ("ball_mm", "12.7", "diameter of a ball (mm)"),
    (
        "pitch_mm",
        "66",
        "diameter of the circle of the balls' centres (mm)",
    ),
    ("rows_mm", "19", "distance of the two rows (mm)"),
    (
        "contact_angle_deg",
        "38",
        "unloaded contact angle (degrees)",
    ),
    (
        "stiffness_n_per_mm_1_5",
        "3e5",
        "load-deflection factor of a ball (N/mm^1.5)",
    ),
    (
        "preload_um",
        "14",
        "approach of each row by the preload (um)",
    ),
    (
        "compliance_um_per_kn",
        "[[0.25, 0, 0, 0, 0], [0, 0.9, 0, 0, 0], [0, 0, 0.7, 0, 0], [0, 0, 0, 0.35, 0], [0, 0, 0, 0, 0.3]]",
        "radial compliance of the outer ring in its seat (um/kN), by a finite-element model or a calibration",
    ),
    (
        "row_coupling",
        "0.5",
        "part of a row's deformation that reaches the other row",
    ),
];

/// Ranges of the loads where no reference shows them, in their order.
const RANGES: [(&str, [f64; 2]); 5] = [
    ("fx_n", [-5000.0, 5000.0]),
    ("fy_n", [-5000.0, 5000.0]),
    ("fz_n", [0.0, 10_000.0]),
    ("mx_nm", [-2000.0, 2000.0]),
    ("mz_nm", [-500.0, 500.0]),
];

impl Source<'_> {
    pub(super) fn bearing(&self, text: &mut Text) -> Result<(), InitError> {
        let gauges = self.of_kind(&[ColumnKind::Strain]);
        let motion = self.of_kind(&[ColumnKind::Counts, ColumnKind::Angle, ColumnKind::Speed]);
        let (Some(gauges), Some(wheel)) = (gauges.get(..GAUGES), motion.first()) else {
            return Err(self.refused(
                "a wheel bearing has four strains (m/m, µm/m) and counts or a speed of the wheel",
            ));
        };
        let loads = self.load_columns();
        text.table("[bearing]");
        for (key, value, what) in FIELDS {
            text.fill_in(key, value, what);
        }
        text.table("[bearing.range]");
        for ((key, range), reference) in RANGES.into_iter().zip(&loads) {
            let found = reference.and_then(|column| {
                let found = column.statistics.as_ref()?;
                let [least, most] = [found.least, found.most].map(|value| column.unit.to_si(value));
                (most > least).then_some([least, most])
            });
            let [least, most] = found.unwrap_or(range);
            let value = format!("[{}, {}]", number(least), number(most));
            text.fill_in(
                key,
                value,
                "the smallest and the largest load that is expected",
            );
        }
        for (i, gauge) in gauges.iter().enumerate() {
            text.table("[[bearing.gauge]]");
            text.set("name", quoted(&gauge.name));
            text.fill_in(
                "azimuth_deg",
                90 * i,
                "where it sits, from x (forward) towards z (up) (degrees)",
            );
        }
        for gauge in gauges {
            let senses = format!("{{ outer_ring = {} }}", quoted(&gauge.name));
            channel(text, gauge, (&senses, None), None);
        }
        self.encoder(text, wheel, Some("wheel"));
        for (load, reference) in BEARING_LOADS.iter().zip(&loads) {
            if let Some(column) = reference {
                references(text, &[column], &[load]);
            }
        }
        self.auxiliaries(text);
        Ok(())
    }

    /// The column of each load: that with its name, else the next force or moment.
    fn load_columns(&self) -> [Option<&ClassifiedColumn>; BEARING_LOADS.len()] {
        let by_name = |load: &str| {
            let has = |column: &&ClassifiedColumn| {
                column.name.to_lowercase().contains(&load.to_lowercase())
            };
            self.of_kind(&[ColumnKind::Force, ColumnKind::Torque])
                .into_iter()
                .find(has)
        };
        let named = BEARING_LOADS.map(by_name);
        if named.iter().any(Option::is_some) {
            return named;
        }
        let mut forces = self.of_kind(&[ColumnKind::Force]).into_iter();
        let mut moments = self.of_kind(&[ColumnKind::Torque]).into_iter();
        BEARING_LOADS.map(|load| {
            if load.starts_with('F') {
                forces.next()
            } else {
                moments.next()
            }
        })
    }
}
