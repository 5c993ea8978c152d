//! Surveys a recording of unknown layout for the draft of a description (`survey`): reads it,
//! changes one layout setting for each error until it can be read, and returns the settings with
//! the reasons, the period (s), and each column with unit and first values.
use std::path::Path;

use super::channel_names::TIMES;
use super::csv::outline;
use super::error::{NO_NAN, Problem, RecordingError};
use super::reader::Reader;
use super::recording_layout::{ChannelLayout, Column, CsvLayout, Role, Timing, Wanted, WrittenNan};
use super::row_source::{Format, Input, Opened};
use super::unit::{Quantity, Unit};
use super::{TIME, shown};

/// Rows of which the values are kept: more do not change what a column looks like.
const ROWS: usize = 1 << 18;

/// Sample rates that a machine description may have (Hz).
pub const RATES_HZ: std::ops::RangeInclusive<f64> = 1.0..=20_000.0;

/// Units of time in the order in which they are tried.
const TIME_UNITS: [&str; 4] = ["s", "ms", "µs", "ns"];

/// Period of rows without a time, until it is filled in (ms).
const ROW_PERIOD_MS: f64 = 1.0;

/// Absent rows in a row up to which a recording has gaps and no other rate.
const LARGEST_GAP: u64 = 1000;

/// A recording as it was found.
#[derive(Clone, Debug)]
pub struct Survey {
    /// CSV, Parquet or MDF4.
    pub format: &'static str,
    /// Settings with which it is read.
    pub layout: CsvLayout,
    /// What was set and is not stated by the file.
    pub changes: Vec<Change>,
    /// All columns but the time.
    pub columns: Vec<SurveyedColumn>,
    /// Rows read.
    pub rows: u64,
    /// Nominal time from row to row (s).
    pub period_s: f64,
    /// Whether the file has a time.
    pub has_time: bool,
    /// What the reader reported, one line each.
    pub notes: Vec<String>,
    /// What refuses the recording in spite of the settings.
    pub refused: Option<String>,
}

/// A setting that was chosen, and why.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Change {
    /// The field of the layout.
    pub field: &'static str,
    /// Why it was chosen.
    pub reason: String,
}

/// A column with what it holds.
#[derive(Clone, Debug)]
pub struct SurveyedColumn {
    /// Its name in the file.
    pub name: String,
    /// Its unit as written; that in its name where the file gives none.
    pub unit: Option<String>,
    /// The first values as written; NaN where there is none. Empty where the column holds no
    /// numbers or its name is there twice.
    pub values: Vec<f64>,
}

impl SurveyedColumn {
    /// Its unit where that is known.
    pub fn known_unit(&self) -> Option<Unit> {
        self.unit.as_deref()?.parse().ok()
    }
}

/// Surveys the recording in `path`.
///
/// # Errors
/// When the file cannot be read or is no recording.
pub fn survey(path: &Path) -> Result<Survey, RecordingError> {
    try_survey(path).map_err(|problem| RecordingError {
        file: path.to_owned(),
        problem,
    })
}

fn try_survey(path: &Path) -> Result<Survey, Problem> {
    let format = Format::open(path, &CsvLayout::default(), &[]);
    let is_text = match &format {
        Ok(format) => format.name() == "CSV",
        Err(Problem::Foreign { .. } | Problem::Io(_) | Problem::Damaged { .. }) => false,
        Err(_) => true,
    };
    let mut layout = match format {
        _ if is_text => outline(path, false)?,
        Ok(_) => CsvLayout::default(),
        Err(problem) => return Err(problem),
    };
    let mut format = Format::open(path, &layout, &[]);
    let mut changes = Vec::new();
    if let Err(problem @ Problem::CommaMeaning { .. }) = &format {
        changes.push(Change {
            field: "decimal_comma",
            reason: problem.to_string(),
        });
        layout.decimal_comma = Some(true);
        format = Format::open(path, &layout, &[]);
    }
    let format = format?;
    let names = format.names()?;
    let asked: Vec<(&str, bool)> = names.iter().map(|name| (name.as_str(), false)).collect();
    let opened = Opened::open(Input::File(path), &layout, &asked)?;
    let mut survey = Survey {
        format: format.name(),
        layout,
        changes,
        columns: Vec::new(),
        rows: 0,
        period_s: 1e-3,
        has_time: true,
        notes: opened.notes.clone(),
        refused: None,
    };
    survey.name_columns(&opened.columns, is_text)?;
    // Each attempt removes one obstacle; there are no more of them than settings and columns.
    for _ in 0..survey.columns.len() + 12 {
        match survey.read(path) {
            Ok(()) if survey.check_time_unit() => return Ok(survey),
            Ok(()) => {}
            Err(problem) => {
                let is_still = matches!(problem, Problem::Backwards { .. });
                if is_still && is_text && survey.has_time {
                    survey.without_time(path, &problem.to_string())?;
                } else if !survey.adapt(&problem) {
                    survey.refused = Some(problem.to_string());
                    return Ok(survey);
                }
            }
        }
    }
    Ok(survey)
}

/// The unit at the end of a name, as in `t_s` and `force_kN`.
fn unit_of_name(name: &str) -> Option<&str> {
    let (_, end) = name.rsplit_once('_')?;
    let unit: Unit = end.parse().ok()?;
    (unit.quantity() != Quantity::Number).then_some(end)
}

impl Survey {
    /// Finds the time among the columns and the units in names.
    fn name_columns(&mut self, columns: &[Column], is_text: bool) -> Result<(), Problem> {
        let unit = |column: &Column| match &column.unit {
            Some(unit) => Some(unit.clone()),
            None => unit_of_name(&column.name).map(str::to_owned),
        };
        let time = time_among(columns, unit);
        let Some(time) = time else {
            if !is_text {
                let found: Vec<_> = columns.iter().map(|c| shown(&c.name)).collect();
                return Err(Problem::Missing {
                    column: format!("`{TIME}`"),
                    found: found.join(", "),
                    nearest: None,
                    is_time: false,
                });
            }
            self.has_time = false;
            self.layout.row_period_ms = Some(ROW_PERIOD_MS);
            self.change("row_period_ms", "no column is a time");
            self.keep(columns, None, unit);
            return Ok(());
        };
        let written = &columns[time];
        let stated = unit(written).and_then(|text| text.parse::<Unit>().ok());
        let known = stated.filter(|unit| unit.quantity() == Quantity::Time);
        if written.name != TIME || written.unit.is_none() {
            if known.is_none() {
                self.change("channels.t", "the time has no unit");
            }
            let is_usual = TIMES.contains(&written.name.to_lowercase().as_str());
            let column = (written.name != TIME && !is_usual).then(|| written.name.clone());
            let needs_unit = written.unit.is_none();
            if column.is_some() || needs_unit {
                let channel = ChannelLayout {
                    column,
                    unit: needs_unit.then(|| known.unwrap_or(Unit::SECOND)),
                    ..ChannelLayout::default()
                };
                self.layout.channels.insert(TIME.into(), channel);
            }
        }
        self.keep(columns, Some(time), unit);
        Ok(())
    }

    fn keep(
        &mut self,
        columns: &[Column],
        time: Option<usize>,
        unit: impl Fn(&Column) -> Option<String>,
    ) {
        let count = |name: &str| columns.iter().filter(|c| c.name == name).count();
        for (i, column) in columns.iter().enumerate() {
            let is_other = Some(i) != time && column.name != TIME && !column.name.is_empty();
            if !is_other || self.columns.iter().any(|known| known.name == column.name) {
                continue;
            }
            let unit = unit(column);
            let is_unique = count(&column.name) == 1;
            if let (None, Some(Ok(unit)), true) =
                (&column.unit, unit.as_deref().map(str::parse), is_unique)
            {
                let channel = ChannelLayout {
                    unit: Some(unit),
                    ..ChannelLayout::default()
                };
                self.layout.channels.insert(column.name.clone(), channel);
            }
            self.columns.push(SurveyedColumn {
                name: column.name.clone(),
                unit,
                // Read where its name is unique.
                values: if is_unique {
                    vec![f64::NAN]
                } else {
                    Vec::new()
                },
            });
        }
    }

    fn change(&mut self, field: &'static str, reason: impl Into<String>) {
        self.changes.retain(|change| change.field != field);
        self.changes.push(Change {
            field,
            reason: reason.into(),
        });
    }

    /// Reads all rows and keeps the first values of each column.
    fn read(&mut self, path: &Path) -> Result<(), Problem> {
        let readable: Vec<usize> = (0..self.columns.len())
            .filter(|i| !self.columns[*i].values.is_empty())
            .collect();
        let wanted: Vec<Wanted<'_>> = readable
            .iter()
            .map(|i| Wanted {
                name: &self.columns[*i].name,
                unit: Unit::ONE,
                required: false,
            })
            .collect();
        // As written, whatever the unit.
        let roles = vec![Role::Pulse; wanted.len()];
        let reader =
            Reader::open_as(path, &self.layout, &wanted, &roles).map_err(|error| error.problem)?;
        let period_s = reader.period_s();
        let notes = reader.notes().to_vec();
        let mut values: Vec<Vec<f64>> = vec![Vec::new(); readable.len()];
        let mut rows = 0;
        let mut refused = None;
        for block in reader {
            let block = match block {
                Ok(block) => block,
                Err(error) => {
                    refused = Some(error.problem);
                    break;
                }
            };
            rows += block.len() as u64;
            for (kept, column) in values.iter_mut().zip(block.columns) {
                let room = ROWS.saturating_sub(kept.len());
                kept.extend(column.into_iter().flatten().take(room));
            }
        }
        for (i, values) in readable.into_iter().zip(values) {
            self.columns[i].values = if values.is_empty() {
                vec![f64::NAN]
            } else {
                values
            };
        }
        (self.rows, self.period_s, self.notes) = (rows, period_s, notes);
        refused.map_or(Ok(()), Err)
    }

    /// Whether the rate is one that a machine may have; else the unit of time is changed.
    fn check_time_unit(&mut self) -> bool {
        let rate_hz = 1.0 / self.period_s;
        if RATES_HZ.contains(&rate_hz) || !self.has_time {
            return true;
        }
        let channel = self.layout.channels.entry(TIME.into()).or_default();
        let tried = channel.unit.map(Unit::symbol);
        let next = match tried {
            None => 0,
            Some(unit) => match TIME_UNITS.iter().position(|other| *other == unit) {
                Some(place) => place + 1,
                None => return true,
            },
        };
        let Some(unit) = TIME_UNITS.get(next).and_then(|unit| unit.parse().ok()) else {
            return true;
        };
        channel.unit = Some(unit);
        let reason = format!(
            "the file's unit of time gives {rate_hz:.3e} Hz, allowed: {} to {}",
            RATES_HZ.start(),
            RATES_HZ.end()
        );
        self.change("channels.t", reason);
        false
    }

    /// Changes a setting so that `problem` is none; false where nothing helps.
    fn adapt(&mut self, problem: &Problem) -> bool {
        let layout = &mut self.layout;
        let reason = problem.to_string();
        match problem {
            Problem::Cell { allowed, .. }
                if *allowed == NO_NAN && layout.written_nan == WrittenNan::Refuse =>
            {
                layout.written_nan = WrittenNan::Missing;
                self.change("written_nan", reason);
                true
            }
            Problem::Cell { column, .. }
            | Problem::NotNumeric { column, .. }
            | Problem::OtherRate { column, .. }
            | Problem::Ambiguous { column, .. } => {
                let is_it =
                    |c: &&mut SurveyedColumn| shown(&c.name) == *column && !c.values.is_empty();
                let found = self.columns.iter_mut().find(is_it);
                found.map(|column| column.values.clear()).is_some()
            }
            Problem::Gap { missing, .. }
                if layout.timing == Timing::Clocked
                    && *missing <= LARGEST_GAP
                    && *missing > u64::from(layout.largest_gap) =>
            {
                layout.largest_gap = *missing as u32;
                self.change("largest_gap", reason);
                true
            }
            Problem::Gap { .. }
            | Problem::SameTick { .. }
            | Problem::Wander { .. }
            | Problem::Rate { .. }
            | Problem::Period { .. } => {
                layout.timing = match layout.timing {
                    Timing::Clocked => Timing::Resample,
                    Timing::Resample => Timing::Free,
                    Timing::Free => return false,
                };
                self.change("timing", reason);
                true
            }
            _ => false,
        }
    }

    /// Leaves the time column out, whose rows do not follow each other.
    fn without_time(&mut self, path: &Path, reason: &str) -> Result<(), Problem> {
        let time = self.layout.column_of(TIME).to_owned();
        let explicit = outline(path, true)?;
        let names = explicit
            .columns
            .iter()
            .map(|text| Column::from_header(text).name);
        let is_time = |name: &String| {
            *name == time || (time == TIME && TIMES.contains(&name.to_lowercase().as_str()))
        };
        let place = names.into_iter().position(|name| is_time(&name));
        self.layout.skip_lines = explicit.skip_lines;
        self.layout.delimiter = explicit.delimiter;
        self.layout.columns = explicit.columns;
        if let Some(column) = place.and_then(|place| self.layout.columns.get_mut(place)) {
            column.clear();
        }
        self.layout.row_period_ms = Some(ROW_PERIOD_MS);
        self.layout.channels.remove(TIME);
        self.has_time = false;
        let reason = format!("the times in column `{time}` are of no use: {reason}");
        self.change("row_period_ms", reason);
        Ok(())
    }
}

/// The column that is the time: by its name, by its unit, then by a name that has the word.
fn time_among(columns: &[Column], unit: impl Fn(&Column) -> Option<String>) -> Option<usize> {
    let by = |is: &dyn Fn(&Column) -> bool| columns.iter().position(is);
    let is_time = |column: &Column| {
        let unit = unit(column).and_then(|text| text.parse::<Unit>().ok());
        unit.is_some_and(|unit| unit.quantity() == Quantity::Time)
    };
    let has_word = |column: &Column| {
        let name = column.name.to_lowercase();
        TIMES.iter().any(|time| name.contains(time))
    };
    by(&|c| c.name == TIME)
        .or_else(|| by(&|c| TIMES.contains(&c.name.to_lowercase().as_str())))
        .or_else(|| by(&is_time))
        .or_else(|| by(&has_word))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(text: &str) -> Survey {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("recording");
        std::fs::write(&path, text).unwrap();
        survey(&path).unwrap()
    }

    fn rows(header: &str, row: impl Fn(u32) -> String) -> String {
        let rows = (0..200).map(|i| row(i) + "\n");
        header.to_owned() + "\n" + &rows.collect::<String>()
    }

    #[test]
    fn units_stand_in_names_and_the_time_is_found() {
        let survey = found(&rows("t_s,pos_counts,note", |i| {
            format!("{},{},x{i}", f64::from(i) * 1e-3, 3 * i)
        }));
        assert!((survey.period_s - 1e-3).abs() < 1e-9);
        assert_eq!(survey.refused, None);
        assert_eq!(survey.layout.column_of("t"), "t_s");
        assert_eq!(survey.columns[0].known_unit(), Some(Unit::COUNTS));
        assert_eq!(survey.columns[0].values[..3], [0.0, 3.0, 6.0]);
        assert!(survey.columns[1].values.is_empty(), "{survey:?}");
    }

    #[test]
    fn a_unit_of_time_that_gives_no_rate_is_replaced() {
        let survey = found(&rows("%a\n%Time [ms], A [counts]", |i| {
            format!("{:.3},{i}", f64::from(i) * 1e-3)
        }));
        assert!((survey.period_s - 1e-3).abs() < 1e-9, "{survey:?}");
        assert_eq!(survey.changes[0].field, "channels.t");
    }

    #[test]
    fn obstacles_are_removed_one_by_one() {
        let gaps = found(&rows("t [s],a [m]", |i| {
            let value = if i == 50 { "nan".into() } else { i.to_string() };
            format!(
                "{},{value}",
                f64::from(if i > 100 { i + 3 } else { i }) * 0.01
            )
        }));
        let fields: Vec<_> = gaps.changes.iter().map(|c| c.field).collect();
        assert_eq!(fields, ["written_nan", "largest_gap"], "{gaps:?}");
        assert_eq!((gaps.rows, gaps.refused), (203, None));

        let still = found(&rows("t [s],a [m]", |i| format!("{},{i}", i / 10)));
        assert_eq!(still.changes[0].field, "row_period_ms");
        assert_eq!(still.columns[0].values.len(), 200);

        let none = found(&rows("a [m],b [A]", |i| format!("{i},{i}")));
        assert!(!none.has_time);
    }
}
