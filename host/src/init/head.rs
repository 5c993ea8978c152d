//! Writes the beginning of a draft description (comments on the columns found, name, sample rate)
//! and its last table `[recording]`, the layout settings with which the recording can be read.

use loadtwin_recording::{ChannelLayout, RATES_HZ, Timing, Unit, WrittenNan};

use super::column_kind::{ClassifiedColumn, ColumnKind};
use super::toml_text::{Text, number, quoted};
use super::{MARK, MachineKind, Source};

/// Difference of a rate from a shorter number that jitter of stamps and quartzes explain.
const SAME_RATE: f64 = 5e-4;

impl Source<'_> {
    pub(super) fn head(&self, text: &mut Text, kind: MachineKind, is_stated: bool) {
        let survey = self.survey;
        let file = self.path.file_name().unwrap_or_default().to_string_lossy();
        text.comment(format_args!(
            "Begun from the recording {} ({}, {} rows at {} Hz).",
            file.escape_debug(),
            survey.format,
            survey.rows,
            number(self.rate_hz()),
        ));
        text.comment(format_args!(
            "Lines that begin with \"{}\" stand above what a recording does not show; the value below holds \
             the place.",
            MARK.trim_end()
        ));
        if let Some(refused) = &survey.refused {
            text.mark(format_args!(
                "a layout under [recording] by which the rows are read; now: {}",
                refused.escape_debug()
            ));
        }
        text.line("#");
        self.list_columns(text);
        text.line("format = 1");
        let stem = self.path.file_stem().unwrap_or_default().to_string_lossy();
        let name = if stem.trim().is_empty() {
            "machine"
        } else {
            &stem
        };
        text.set("name", quoted(name));
        if survey.has_time {
            text.set("rate_hz", number(self.rate_hz()));
        } else {
            text.fill_in("rate_hz", number(self.rate_hz()), "the sample rate (Hz)");
        }
        let others = match kind {
            _ if is_stated => return,
            MachineKind::Drivetrain => "rotor, bearing or drive",
            MachineKind::Rotor => "drivetrain, bearing or drive",
            MachineKind::Bearing => "drivetrain, rotor or drive",
            MachineKind::Drive => "drivetrain, rotor or bearing",
        };
        text.line("");
        text.comment(format_args!(
            "The kind of machine is by the columns; `--kind` begins another: {others}."
        ));
    }

    /// Name, unit and kind of each column as comments.
    fn list_columns(&self, text: &mut Text) {
        let width = self
            .columns
            .iter()
            .map(|c| c.name.chars().count())
            .max()
            .unwrap_or(0)
            .min(40);
        for column in self.columns {
            let name = column.name.escape_debug().to_string();
            let unit = column
                .written_unit
                .as_deref()
                .unwrap_or("no unit")
                .escape_debug()
                .to_string();
            text.line(format_args!(
                "#   {name:width$}  {unit:8}  {}",
                seen(column)
            ));
        }
    }

    /// The shortest number that the rows' rate may be (Hz).
    pub(super) fn rate_hz(&self) -> f64 {
        let found = 1.0 / self.survey.period_s;
        let rounded = (0..6).map(|digits| format!("{found:.digits$e}").parse().unwrap_or(found));
        let mut near = rounded.filter(|rate: &f64| (rate / found - 1.0).abs() < SAME_RATE);
        near.next()
            .unwrap_or(found)
            .clamp(*RATES_HZ.start(), *RATES_HZ.end())
    }

    /// The table `[recording]`, where the usual one does not read the file.
    pub(super) fn recording(&self, text: &mut Text) {
        let layout = &self.survey.layout;
        let reason = |field: &str| {
            let change = self
                .survey
                .changes
                .iter()
                .find(|change| change.field == field);
            change.map(|change| change.reason.escape_debug().to_string())
        };
        let mut body = Vec::new();
        if layout.skip_lines > 0 {
            body.push((None, format!("skip_lines = {}", layout.skip_lines)));
        }
        if let Some(delimiter) = layout.delimiter {
            body.push((
                None,
                format!("delimiter = {}", quoted(&delimiter.to_string())),
            ));
        }
        if !layout.columns.is_empty() {
            let names: Vec<_> = layout
                .columns
                .iter()
                .map(|name| format!("    {},\n", quoted(name)))
                .collect();
            body.push((None, format!("columns = [\n{}]", names.concat())));
        }
        if let Some(period_ms) = layout.row_period_ms {
            let what = "the time from row to row (ms)".to_owned();
            let what =
                reason("row_period_ms").map_or(what.clone(), |reason| format!("{what}; {reason}"));
            body.push((Some(what), format!("row_period_ms = {}", number(period_ms))));
        }
        if layout.written_nan == WrittenNan::Missing {
            body.push((
                Some("is a written NaN a missing sample?".to_owned()),
                "written_nan = \"missing\"".into(),
            ));
        }
        if layout.timing != Timing::Clocked {
            let name = if layout.timing == Timing::Resample {
                "resample"
            } else {
                "free"
            };
            let what = format!(
                "are the rows those of no common clock? {}",
                reason("timing").unwrap_or_default()
            );
            body.push((Some(what), format!("timing = \"{name}\"")));
        }
        if layout.largest_gap > 0 {
            let what = format!(
                "may rows be absent? {}",
                reason("largest_gap").unwrap_or_default()
            );
            body.push((Some(what), format!("largest_gap = {}", layout.largest_gap)));
        }
        let channels = self.channels_of_the_layout(reason("channels.t").as_deref());
        if body.is_empty() && channels.is_empty() {
            return;
        }
        text.table("[recording]");
        write(text, body);
        if !channels.is_empty() {
            text.table("[recording.channels]");
            write(text, channels);
        }
    }

    fn channels_of_the_layout(&self, time: Option<&str>) -> Vec<(Option<String>, String)> {
        let mut lines = Vec::new();
        for (name, channel) in &self.survey.layout.channels {
            let what = time.filter(|_| name == "t");
            let what = what.map(|reason| format!("the unit of time; {reason}"));
            lines.push((what, entry(name, channel)));
        }
        let is_bare = |column: &&ClassifiedColumn| {
            !column.has_unit && !column.is(&[ColumnKind::Other]) && column.statistics.is_some()
        };
        for column in self.columns.iter().filter(is_bare) {
            let written = column.written_unit.as_deref().unwrap_or("none");
            let what = format!("the unit; the recording has {}", written.escape_debug());
            let channel = ChannelLayout {
                unit: Some(Unit::COUNTS),
                ..ChannelLayout::default()
            };
            lines.push((Some(what), entry(&column.name, &channel)));
        }
        lines
    }
}

fn write(text: &mut Text, lines: Vec<(Option<String>, String)>) {
    for (what, line) in lines {
        if let Some(what) = what {
            text.mark(what);
        }
        text.line(line);
    }
}

fn entry(name: &str, channel: &ChannelLayout) -> String {
    let column = channel
        .column
        .as_ref()
        .map(|column| format!("column = {}", quoted(column)));
    let unit = channel
        .unit
        .map(|unit| format!("unit = {}", quoted(unit.symbol())));
    let fields: Vec<_> = column.into_iter().chain(unit).collect();
    format!("{} = {{ {} }}", quoted(name), fields.join(", "))
}

/// Kind of a column in words.
fn seen(column: &ClassifiedColumn) -> String {
    let what = match column.kind {
        ColumnKind::Strain => "strain",
        ColumnKind::BridgeRatio => "strain bridge",
        ColumnKind::Words => "words of a converter",
        ColumnKind::Counts => "counts of an encoder",
        ColumnKind::Angle => "angle",
        ColumnKind::Index => "index pulse",
        ColumnKind::Torque => "torque",
        ColumnKind::Force => "force",
        ColumnKind::Length => "displacement",
        ColumnKind::Speed | ColumnKind::LinearSpeed => "speed",
        ColumnKind::Temperature => "temperature",
        ColumnKind::Current => "current",
        ColumnKind::Voltage => "voltage",
        ColumnKind::Other => "not used",
        ColumnKind::Unknown => "of unknown kind",
    };
    let Some(found) = &column.statistics else {
        return format!("{what}: no values, or a name that is there twice");
    };
    let range = format!("{what}, {} to {}", number(found.least), number(found.most));
    match column.kind {
        ColumnKind::Counts => {
            let width = found
                .wraps_at_bits
                .map_or("no wrap".into(), |bits| format!("wraps at {bits} bit"));
            let way = if found.motion < 0.0 { "down" } else { "up" };
            format!(
                "{range}, {width}, counts {way} by {}",
                number(found.motion.abs())
            )
        }
        ColumnKind::Index if found.empty > 0.5 => {
            format!("{range}, empty in {:.1} % of rows", 100.0 * found.empty)
        }
        ColumnKind::Index | ColumnKind::Other => range,
        _ => format!("{range}, white noise {}", number(found.noise_std)),
    }
}
