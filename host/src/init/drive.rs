//! Writes the table `[balance]` of a drive without gauges into a draft description: chooses drive
//! signal, position, speed, temperature and loads among the columns of the recording, and marks
//! each choice that is not certain.

use std::f64::consts::TAU;

use loadtwin_recording::{Quantity, Unit};

use super::column_kind::{ClassifiedColumn, ColumnKind};
use super::sensor_tables::COUNTS_PER_TURN;
use super::toml_text::{Text, quoted, rounded_up};
use super::{InitError, Source};

/// What may be a drive, the surest first.
const DRIVES: [&[ColumnKind]; 4] = [
    &[ColumnKind::Current],
    &[ColumnKind::Voltage],
    &[ColumnKind::Torque, ColumnKind::Force],
    &[ColumnKind::Words, ColumnKind::Unknown, ColumnKind::Strain],
];

impl Source<'_> {
    pub(super) fn drive(&self, text: &mut Text) -> Result<(), InitError> {
        let likely = DRIVES.iter().flat_map(|kinds| self.of_kind(kinds));
        // Where nothing shows what a column is, all may be it.
        let any = self
            .of_kind(&[ColumnKind::Index, ColumnKind::Counts])
            .into_iter();
        let any = any.filter(|column| !column.has_unit || column.kind == ColumnKind::Index);
        let candidates: Vec<&ClassifiedColumn> = likely.chain(any).collect();
        let mut positions =
            self.of_kind(&[ColumnKind::Counts, ColumnKind::Angle, ColumnKind::Length]);
        // A measured position is a whole number of steps, a commanded one is not.
        positions.sort_by_key(|column| column.statistics.as_ref().is_none_or(|s| s.step.is_none()));
        let speeds = self.of_kind(&[ColumnKind::Speed, ColumnKind::LinearSpeed]);
        let drive = candidates.first().copied();
        let needed = "a drive has a torque, force, current or voltage, and a position or speed";
        let drive = drive.ok_or_else(|| self.refused(needed))?;
        let is_free = |column: &&&ClassifiedColumn| column.name != drive.name;
        let position = positions.first();
        let speed = speeds.first();
        let motion = candidates.iter().find(is_free);
        if position.is_none() && speed.is_none() && motion.is_none() {
            return Err(self.refused(needed));
        }
        text.table("[balance]");
        if !self.survey.has_time {
            text.fill_in(
                "regime",
                "\"holding\"",
                "is each row a position that is held (holding), or a sample (moving)?",
            );
        }
        text.set_or_fill_in(
            "unit",
            drive_unit(drive).map(|unit| quoted(unit.symbol())),
            "\"Nm\"",
            "the unit of the drive after its gain: Nm, N, A, V",
        );
        let others = names(&candidates, drive);
        let what = "the torque, force, current or voltage that drives";
        mark_choice(text, "drive", what, &others);
        signal(text, "drive", drive, None);
        if let Some(position) = position {
            mark_choice(
                text,
                "position",
                "the position",
                &names(&positions, position),
            );
            signal(text, "position", position, Some(TAU / COUNTS_PER_TURN));
        }
        if let Some(speed) = speed {
            mark_choice(text, "speed", "the speed", &names(&speeds, speed));
            signal(text, "speed", speed, None);
        }
        if let (None, None, Some(motion)) = (position, speed, motion) {
            text.mark(format_args!(
                "the motion: position or speed; found as well: {}",
                names(&candidates, motion)
            ));
            signal(text, "speed", motion, None);
        }
        body(text, drive, position.copied());
        self.temperature(text);
        loads(text, &candidates, drive);
        Ok(())
    }

    fn temperature(&self, text: &mut Text) {
        for column in self.of_kind(&[ColumnKind::Temperature]).iter().take(1) {
            signal(text, "temperature", column, None);
        }
    }
}

fn body(text: &mut Text, drive: &ClassifiedColumn, position: Option<&ClassifiedColumn>) {
    let turns =
        position.is_none_or(|column| matches!(column.kind, ColumnKind::Counts | ColumnKind::Angle));
    if turns {
        text.fill_in(
            "turn",
            "6.283185307",
            "the travel of one turn of the motor (rad or m)",
        );
    }
    text.fill_in("inertia", "0", "the moving inertia or mass (kg m2, kg)");
    let gain = gain(drive).unwrap_or(1.0);
    text.fill_in(
        "nominal",
        rounded_up((drive.largest() * gain).abs()),
        "the rated drive",
    );
}

/// Torques and forces beside the drive.
fn loads(text: &mut Text, candidates: &[&ClassifiedColumn], drive: &ClassifiedColumn) {
    let is_load = |column: &&&ClassifiedColumn| {
        column.name != drive.name && column.is(&[ColumnKind::Torque, ColumnKind::Force])
    };
    for column in candidates.iter().filter(is_load) {
        text.table("[[balance.load]]");
        text.mark("is it a load that the drive works against? Delete the table where it is none");
        text.set("name", quoted(&column.name));
        text.set("unit", quoted(column.unit.symbol()));
        gain_of(text, column, None);
    }
}

fn names(columns: &[&ClassifiedColumn], chosen: &ClassifiedColumn) -> String {
    let others = columns.iter().filter(|column| column.name != chosen.name);
    let others: Vec<_> = others
        .map(|column| column.name.escape_debug().to_string())
        .collect();
    others.join(", ")
}

fn mark_choice(text: &mut Text, key: &str, what: &str, others: &str) {
    if !others.is_empty() {
        text.mark(format_args!("{what} (`{key}`); found as well: {others}"));
    }
}

/// The unit of the drive after its gain.
fn drive_unit(column: &ClassifiedColumn) -> Option<Unit> {
    let is_known = !matches!(column.unit.quantity(), Quantity::Counts | Quantity::Number);
    is_known.then(|| column.unit.si())
}

/// SI units in one of the column's; none where it is of no quantity.
fn gain(column: &ClassifiedColumn) -> Option<f64> {
    drive_unit(column).map(|_| column.unit.to_si(1.0) - column.unit.to_si(0.0))
}

/// A signal as an inline table; `counts`: the gain of counts until it is filled in.
fn signal(text: &mut Text, key: &str, column: &ClassifiedColumn, counts: Option<f64>) {
    let gain = match gain(column) {
        Some(1.0) => String::new(),
        Some(gain) => format!(", gain = {gain:e}"),
        None => {
            text.mark(format_args!(
                "`gain` of {}, SI per {}",
                column.name.escape_debug(),
                column.unit
            ));
            format!(", gain = {:e}", counts.unwrap_or(1.0))
        }
    };
    let (name, unit) = (quoted(&column.name), quoted(column.unit.symbol()));
    text.set(
        key,
        format_args!("{{ name = {name}, unit = {unit}{gain} }}"),
    );
}

fn gain_of(text: &mut Text, column: &ClassifiedColumn, counts: Option<f64>) {
    match gain(column) {
        Some(1.0) => {}
        Some(gain) => text.set("gain", format_args!("{gain:e}")),
        None => {
            let what = format_args!("the drive's unit per {}, with the sign", column.unit);
            text.fill_in("gain", format_args!("{:e}", counts.unwrap_or(1.0)), what);
            text.fill_in("zero", "0", "the reading without load");
        }
    }
}
