//! The table `[recording]` of a machine description (`CsvLayout`, also for Parquet and MDF4): text
//! format, timing, gaps, and column, unit and type of each channel; read from TOML. Also the
//! columns that a caller asks for (`Wanted`, `Role`) and those of a file (`Column`, from
//! `name [unit]`).
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use loadtwin_files::bounded::{DESCRIPTION, read_text};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::error::{Problem, RecordingError};
use super::unit::Unit;

/// Layout of a recording: the table `[recording]` of a machine description, or
/// a file of its own that several machines share.
///
/// The defaults read what `loadtwin` writes: comma-separated, `#` comments, a
/// header `t [s],ta1 [µm/m],...`. What is absent is recognised where the file
/// leaves one possibility, and reported. `delimiter`, `comment`, `skip_lines`,
/// `columns`, `decimal_comma`, `encoding` and `row_period_ms` are for text; the
/// others hold for Parquet and MDF4 as well.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CsvLayout {
    /// A layout file (TOML, these same fields at its top level), relative to
    /// the machine description. It replaces all other fields of this table but
    /// `channels`, which are added to its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub layout: Option<PathBuf>,
    /// Separator of the columns: one ASCII character. Absent: the one of `,`,
    /// `;`, tab and `|` that makes a table of numbers, or that of a first line
    /// `sep=;`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub delimiter: Option<char>,
    /// A line that begins with this is a comment: `#` unless given.
    pub comment: String,
    /// Lines to leave out at the top of the file, comments included. Where
    /// `columns` is given, the file's own header lines belong to them.
    pub skip_lines: u32,
    /// Names and units of the columns, each `name [unit]`, for files without
    /// such a header. The time is `t`. An empty name leaves a column out.
    pub columns: Vec<String>,
    /// Numbers have a decimal comma: `1,5`. Needs another `delimiter`. Absent:
    /// so where the first rows have commas in their numbers and no points.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub decimal_comma: Option<bool>,
    /// How the text is encoded: `utf-8`, `utf-16le`, `utf-16be`, `windows-1252`
    /// or another name of the WHATWG Encoding Standard. Absent: by the byte
    /// order mark, else UTF-8, else Windows-1252.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub encoding: Option<String>,
    /// What a `NaN` written in a channel means. An empty cell (in Parquet a
    /// null) is always a missing sample.
    pub written_nan: WrittenNan,
    /// What text files write in place of a missing sample, such as `n/a`, `---` or `-999`; of the
    /// time nothing is missing.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub missing: Vec<String>,
    /// Samples in a row that may be absent from the file: 0 unless given. They
    /// are put in as rows without values, and the estimator flags them; a
    /// longer gap is an error.
    pub largest_gap: u32,
    /// Time from row to row (ms), above 0 up to 3.6e6, for text files without a time
    /// column, such as 0.5 at 2 kHz; `columns` then names none. Absent unless given.
    pub row_period_ms: Option<f64>,
    /// What the times of the rows are: `clocked` unless given.
    pub timing: Timing,
    /// How the file calls and writes a channel, by the channel's name in the
    /// machine description; the time is `t`.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub channels: BTreeMap<String, ChannelLayout>,
    /// Sample rate that the machine description states (Hz); of several groups
    /// of an MDF4 file that have a channel, the one of this rate is read.
    #[serde(skip)]
    pub rate_hz: Option<f64>,
}

/// What the times of a recording's rows are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Timing {
    /// Time stamps of samples that a clock took. A row belongs to the tick that
    /// is nearest to its time; each tick has one row at most, less than half a
    /// period off; ticks without a row are missing samples (`largest_gap`).
    #[default]
    Clocked,
    /// Exact times of values that no common clock took, or another than the
    /// estimator's: values are brought onto the ticks of the estimator, gauges
    /// by a filter with its band, counts by interpolation, an index pulse as it is.
    Resample,
    /// Times of a loop without a clock, for a `[balance]`: each period counts from
    /// the row before, and values stand at their times.
    Free,
}

impl Default for CsvLayout {
    fn default() -> Self {
        Self {
            layout: None,
            delimiter: None,
            comment: "#".into(),
            skip_lines: 0,
            columns: Vec::new(),
            decimal_comma: None,
            encoding: None,
            written_nan: WrittenNan::Refuse,
            missing: Vec::new(),
            largest_gap: 0,
            row_period_ms: None,
            timing: Timing::Clocked,
            channels: BTreeMap::new(),
            rate_hz: None,
        }
    }
}

impl CsvLayout {
    /// Refuses a row period that is no time, and a begin of comments that rows have too.
    pub(super) fn check(&self) -> Result<(), Problem> {
        let begins_row = |c: char| c.is_ascii_digit() || matches!(c, '-' | '+' | '.' | ',');
        if self.comment.starts_with(begins_row) {
            return Err(Problem::Layout {
                field: "comment",
                found: format!("{:?}", self.comment),
                allowed: "what no row begins with: no digit, sign, point or comma",
            });
        }
        match self.row_period_ms {
            Some(ms) if !(ms > 0.0 && ms <= 3.6e6) => Err(Problem::Layout {
                field: "row_period_ms",
                found: ms.to_string(),
                allowed: "above 0, up to 3600000",
            }),
            _ => Ok(()),
        }
    }

    /// Layout of a text file that `loadtwin simulate` wrote for a machine whose logger writes
    /// otherwise: names, units and text are the program's own.
    pub(super) fn of_simulated(&self) -> Self {
        Self {
            written_nan: self.written_nan,
            largest_gap: self.largest_gap,
            timing: self.timing,
            rate_hz: self.rate_hz,
            ..Self::default()
        }
    }

    /// Reads a layout file.
    ///
    /// # Errors
    /// When it cannot be read, is no TOML, or has a field that is not known.
    pub fn load(path: &Path) -> Result<Self, RecordingError> {
        let failed = |problem| RecordingError {
            file: path.to_owned(),
            problem,
        };
        let text = read_text(path, DESCRIPTION).map_err(|e| failed(e.into()))?;
        let layout: Self = toml::from_str(&text).map_err(|error| {
            let before = error.span().map_or("", |span| &text[..span.start]);
            failed(Problem::LayoutFile {
                line: 1 + before.matches('\n').count(),
                found: error.message().replace('\n', "; "),
            })
        })?;
        if let Some(other) = &layout.layout {
            return Err(failed(Problem::Layout {
                field: "layout",
                found: format!("{:?}", other.display().to_string()),
                allowed: "no further file in a layout file",
            }));
        }
        Ok(layout)
    }

    /// The layout in the file that this one names, with its own channels added;
    /// itself where it names none. `folder` is where the file is looked for.
    ///
    /// # Errors
    /// As [`CsvLayout::load`], and when it has other fields than `channels`.
    pub fn resolved(mut self, folder: &Path) -> Result<Self, RecordingError> {
        let Some(file) = self.layout.take() else {
            return Ok(self);
        };
        let channels = std::mem::take(&mut self.channels);
        let rate_hz = self.rate_hz.take();
        if self != Self::default() {
            return Err(RecordingError {
                file: folder.join(&file),
                problem: Problem::Layout {
                    field: "layout",
                    found: format!("{:?}", file.display().to_string()),
                    allowed: "with no other field than `channels`; the others belong into that file",
                },
            });
        }
        let mut shared = Self::load(&folder.join(file))?;
        shared.channels.extend(channels);
        shared.rate_hz = rate_hz;
        Ok(shared)
    }

    /// How the file writes channel `name`, where the layout says it.
    pub(super) fn channel(&self, name: &str) -> Option<&ChannelLayout> {
        self.channels.get(name)
    }

    /// How the file calls channel `name`.
    pub(super) fn column_of<'a>(&'a self, name: &'a str) -> &'a str {
        let layout = self.channel(name).and_then(|c| c.column.as_deref());
        layout.unwrap_or(name)
    }

    /// The layout of the channel that file column `column` stands for.
    pub(super) fn layout_of_column(&self, column: &str) -> Option<&ChannelLayout> {
        self.channels
            .iter()
            .find(|(name, channel)| channel.column.as_ref().unwrap_or(name) == column)
            .map(|(_, channel)| channel)
    }
}

/// How a logger writes one channel.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ChannelLayout {
    /// Name of its column (in MDF4 of its channel), without the unit. Absent:
    /// the name of the channel.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub column: Option<String>,
    /// Unit of its values, in place of the one that the file states.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unit: Option<Unit>,
    /// What its values are. Absent: by the type of the column, in text by the
    /// first rows.
    #[serde(rename = "type", skip_serializing_if = "Option::is_none")]
    pub kind: Option<ColumnType>,
    /// How a `timestamp` is written in text, as `strftime` has it:
    /// `%d.%m.%Y %H:%M:%S%.f`. Absent: ISO 8601.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub format: Option<String>,
    /// Channel group of an MDF4 file that it is read from: its acquisition name
    /// or its number, from 1. Absent: the group that has it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub group: Option<String>,
}

/// What the values of a column are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ColumnType {
    /// Numbers, also where they are written as text.
    Number,
    /// True and false, read as 1 and 0.
    Boolean,
    /// Points in time, read as seconds since the first row.
    Timestamp,
    /// Times as `hours:minutes:seconds`, read as seconds.
    Duration,
}

/// What a `NaN` in a channel of a recording means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum WrittenNan {
    /// An error of the recording, named with its row and column.
    Refuse,
    /// A missing sample, as an empty cell is.
    Missing,
}

/// A column that the caller wants, and the unit it wants the values in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wanted<'a> {
    /// Name of the column.
    pub name: &'a str,
    /// Unit of the values handed out; the recording may use any unit of the
    /// same quantity.
    pub unit: Unit,
    /// Whether a recording without it is refused.
    pub required: bool,
}

/// What a column is, where rows are brought onto other ticks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Role {
    /// A quantity with a value at any time, whose band a filter limits.
    #[default]
    Continuous,
    /// A count or an angle: interpolated, never filtered.
    Counts {
        /// Values after which it begins anew; none where it does not.
        modulus: Option<f64>,
    },
    /// An index pulse, handed out as written, whatever its unit: what matters is
    /// the row in which it comes.
    Pulse,
}

/// A column as the recording has it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Column {
    /// Name, without the unit.
    pub name: String,
    /// Unit as written; none where the recording gives none. Only the units of
    /// wanted columns need be known to [`Unit`].
    pub unit: Option<String>,
}

impl Column {
    /// Splits a header `name [unit]`.
    pub(super) fn from_header(text: &str) -> Self {
        let text = text.trim();
        let bracketed = |open: char, close: char| {
            let inside = text.strip_suffix(close)?.rsplit_once(open)?;
            Some(inside).filter(|(name, _)| !name.trim().is_empty())
        };
        // A name may end with parentheses that hold no unit.
        let parenthesised = || bracketed('(', ')').filter(|(_, unit)| is_unit(unit));
        let split = bracketed('[', ']').or_else(parenthesised);
        match split {
            Some((name, unit)) => Self {
                name: name.trim().into(),
                unit: Some(unit.trim().into()),
            },
            None => Self {
                name: text.into(),
                unit: None,
            },
        }
    }
}

/// Whether a text is a unit; a number is not, which programs add to names that are there twice.
fn is_unit(text: &str) -> bool {
    let text = text.trim();
    !text.is_empty()
        && !text.starts_with(|c: char| c.is_ascii_digit())
        && text.parse::<Unit>().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn header_of_a_column() {
        let column = |name: &str, unit: Option<&str>| Column {
            name: name.into(),
            unit: unit.map(Into::into),
        };
        for (text, expected) in [
            ("t [s]", column("t", Some("s"))),
            (" ta1[µm/m] ", column("ta1", Some("µm/m"))),
            ("bare", column("bare", None)),
            ("m [1] [Nm]", column("m [1]", Some("Nm"))),
            ("[s]", column("[s]", None)),
            ("t (s)", column("t", Some("s"))),
            ("ta1 (µm/m)", column("ta1", Some("µm/m"))),
            ("ta1 (left)", column("ta1 (left)", None)),
            ("ta1 (1)", column("ta1 (1)", None)),
            ("x [", column("x [", None)),
        ] {
            assert_eq!(Column::from_header(text), expected, "{text}");
        }
    }

    #[test]
    fn unknown_field_is_refused() {
        let error = toml::from_str::<CsvLayout>("delimeter = ';'").unwrap_err();
        assert!(error.to_string().contains("delimeter"), "{error}");
        let layout: CsvLayout = toml::from_str("delimiter = ';'\nlargest_gap = 2").unwrap();
        assert_eq!((layout.delimiter, layout.largest_gap), (Some(';'), 2));
    }

    #[test]
    fn channels_by_name() {
        let text =
            "[channels]\nta1 = { column = 'CH 1', unit = 'µm/m' }\nt = { type = 'timestamp' }";
        let layout: CsvLayout = toml::from_str(text).unwrap();
        assert_eq!(layout.column_of("ta1"), "CH 1");
        assert_eq!(layout.column_of("t"), "t");
        let time = layout.channel("t").and_then(|c| c.kind);
        assert_eq!(time, Some(ColumnType::Timestamp));
        assert!(layout.layout_of_column("CH 1").is_some());
        assert!(layout.layout_of_column("ta1").is_none());
    }
}
