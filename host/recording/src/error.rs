//! The errors of reading and writing a recording: `RecordingError` names the file, `Problem` lists
//! the kinds, each with a one-line message of row, value found and values allowed. `clipped` makes
//! foreign text fit into such a line.
use std::fmt;
use std::io;
use std::path::PathBuf;

/// Names the file, the place in it, what was found there and what is allowed.
#[derive(Debug, thiserror::Error)]
#[error("{}: {problem}", file.display())]
pub struct RecordingError {
    /// The recording, as it was named by the caller.
    pub file: PathBuf,
    /// What is wrong with it.
    #[source]
    pub problem: Problem,
}

/// A sample of a recording: its row and, in a text file, its line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Row {
    /// Number of the sample, from 1.
    pub row: u64,
    /// Line of a text file, from 1, header and comments counted.
    pub line: Option<u64>,
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "row {}", self.row)?;
        match self.line {
            Some(line) => write!(f, " (line {line})"),
            None => Ok(()),
        }
    }
}

/// What is wrong with a recording.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Problem {
    /// The operating system refused.
    #[error("cannot be read: {0}")]
    Io(#[from] io::Error),
    /// The operating system refused to write.
    #[error("cannot be written: {0}")]
    Unwritable(#[source] io::Error),
    /// A file to write that is of no known format.
    #[error("cannot be written with the extension `{found}`; allowed: csv, parquet, mf4")]
    Extension {
        /// Extension of its name.
        found: String,
    },
    /// More than fits into a file that is put together in memory.
    #[error(
        "cannot be written as MDF4 with {found} values; allowed: {allowed} (CSV and Parquet have no limit)"
    )]
    TooLong {
        /// Values, rows times columns.
        found: usize,
        /// Most values.
        allowed: usize,
    },
    /// Not one byte, or only comments.
    #[error("is empty; allowed: a header and at least 2 rows")]
    Empty,
    /// A header and nothing to estimate from.
    #[error("has {found} rows; allowed: at least 2")]
    TooShort {
        /// Rows there.
        found: u64,
    },
    /// Text whose lines end with a carriage return alone.
    #[error("its lines end with CR alone; allowed: LF or CR LF (`tr '\\r' '\\n' < FILE` converts)")]
    CarriageReturns,
    /// Neither Parquet nor MDF4 by its first bytes, and not text either.
    #[error(
        "line {line} is not text, found `{found}`; allowed: CSV, Parquet, MDF4 (`encoding` under \
         [recording] names another encoding of text)"
    )]
    NotText {
        /// Line, from 1.
        line: u64,
        /// How the line begins.
        found: String,
    },
    /// A text file without line ends.
    #[error("line {line} is longer than {limit} bytes; allowed: CSV, Parquet, MDF4")]
    LineTooLong {
        /// Line, from 1.
        line: u64,
        /// Longest line allowed.
        limit: usize,
    },
    /// A first line of numbers.
    #[error(
        "line {line} is not a header, found the number `{found}`; allowed: `name [unit]` for each \
         column, or `columns` under [recording] in the machine description"
    )]
    NoHeader {
        /// Line, from 1.
        line: u64,
        /// Its first cell.
        found: String,
    },
    /// Two columns of one name.
    #[error("column `{name}` is there twice; allowed: one column of each name that is read")]
    Duplicate {
        /// The name.
        name: String,
    },
    /// A column that the caller cannot do without.
    #[error("column {column} is missing; found: {found}{}{}", .nearest.as_ref().map(|n| format!("; did you mean `{n}`?")).unwrap_or_default(), if *.is_time { NO_TIME } else { "" })]
    Missing {
        /// Its name in the file in backquotes, and the channel where that is called otherwise.
        column: String,
        /// The columns there.
        found: String,
        /// The column there with the most similar name.
        nearest: Option<String>,
        /// Whether it is the time.
        is_time: bool,
    },
    /// A column without a unit.
    #[error(
        "column `{column}` has no unit; allowed: {allowed}, in the file or as `unit` of the \
         channel under [recording.channels]"
    )]
    NoUnit {
        /// The column.
        column: String,
        /// Units of the quantity wanted.
        allowed: String,
    },
    /// A unit of another quantity, or one that is not known.
    #[error("column `{column}` has the unit `{found}`; allowed: {allowed}")]
    WrongUnit {
        /// The column.
        column: String,
        /// Unit found.
        found: String,
        /// Units of the quantity wanted.
        allowed: String,
    },
    /// A file of a format that is not read.
    #[error("is a file of the format {name}; allowed: CSV, Parquet, MDF4; {remedy}")]
    Foreign {
        /// Name of the format.
        name: &'static str,
        /// What converts it.
        remedy: &'static str,
    },
    /// A column of text or lists.
    #[error(
        "column `{column}` holds {found}; allowed: numbers, Booleans, timestamps, times of day, durations \
         (`type` of the channel under [recording.channels] reads text as one of them)"
    )]
    NotNumeric {
        /// The column.
        column: String,
        /// Type found.
        found: String,
    },
    /// Numbers with one comma before three digits each.
    #[error(
        "cannot be read without `decimal_comma` under [recording]: every comma may be a decimal comma or \
         part the thousands, found `{found}`; allowed: true or false"
    )]
    CommaMeaning {
        /// One of them.
        found: String,
    },
    /// A row of another length than the header's.
    #[error(
        "{row} has {found} columns; allowed: {allowed}{}",
        if *.last { " (it is the last row: the file seems to be cut off)" } else { "" }
    )]
    RowLength {
        /// Where.
        row: Row,
        /// Columns found.
        found: usize,
        /// Columns of the header.
        allowed: usize,
        /// Whether the file ends there.
        last: bool,
    },
    /// A cell that is no usable number.
    #[error("{row}, column `{column}`: found `{found}`; allowed: {allowed}")]
    Cell {
        /// Where.
        row: Row,
        /// The column.
        column: String,
        /// What the cell holds.
        found: String,
        /// What it may hold.
        allowed: &'static str,
    },
    /// Time that stands still or runs backwards.
    #[error(
        "{row}: time goes from {before} s to {found} s; allowed: only forwards{}",
        if *.continues {
            " from the recording before, in seconds of one clock (timestamps count from the first row of their file)"
        } else {
            ""
        }
    )]
    Backwards {
        /// Where.
        row: Row,
        /// Time of the row before, s.
        before: f64,
        /// Time of this row, s.
        found: f64,
        /// Whether the row before is in the recording before.
        continues: bool,
    },
    /// Samples are missing.
    #[error(
        "{row}: gap of {gap_s:.6} s after t = {before} s: {missing} samples are missing; allowed: \
         {allowed} at the sample period of {period_s:.6} s (`largest_gap` under [recording] allows \
         more)"
    )]
    Gap {
        /// Row after the gap.
        row: Row,
        /// Time of the row before, s.
        before: f64,
        /// From one row to the next, s.
        gap_s: f64,
        /// Samples that the clock of the recording took in between.
        missing: u64,
        /// Most samples that may be missing in a row.
        allowed: u32,
        /// Nominal step, s.
        period_s: f64,
    },
    /// Two rows of one sample.
    #[error(
        "{row} at t = {t} s is not on the clock of the recording: {other} at t = {other_t} s falls \
         on the same tick; allowed: one row every {period_s:.6} s, each less than half of that \
         off ({RESAMPLE})"
    )]
    SameTick {
        /// The row further from the tick.
        row: Row,
        /// Its time, s.
        t: f64,
        /// The other.
        other: Row,
        /// Its time, s.
        other_t: f64,
        /// Nominal step, s.
        period_s: f64,
    },
    /// The clock's rate goes up and down.
    #[error(
        "{row}: at t = {t} s the clock wanders by more than a quarter of a period ({period_s:.6} s) within \
         32 rows; allowed: a rate that changes more slowly ({RESAMPLE})"
    )]
    Wander {
        /// The row where that shows.
        row: Row,
        /// Its time, s.
        t: f64,
        /// Nominal step, s.
        period_s: f64,
    },
    /// The clock's rate is not the same all along.
    #[error(
        "{row}: from t = {t} s on rows come every {found_s:.6} s, before every {period_s:.6} s; \
         allowed: one sample period within 2 % ({RESAMPLE})"
    )]
    Rate {
        /// First row where that shows.
        row: Row,
        /// Its time, s.
        t: f64,
        /// Step from there on, s.
        found_s: f64,
        /// Nominal step, s.
        period_s: f64,
    },
    /// Recorded at another rate than the machine description says.
    #[error(
        "is sampled every {found_s:.6} s ({} Hz); allowed: {allowed_s:.6} s ({} Hz) within 2 %, the `rate_hz` of \
         the machine description ({RESAMPLE})",
        hertz(*.found_s), hertz(*.allowed_s)
    )]
    Period {
        /// Median step of the recording, s.
        found_s: f64,
        /// Step expected, s.
        allowed_s: f64,
    },
    /// The sensors of an MDF4 file are recorded at different rates.
    #[error(
        "column `{column}` has a sample every {found_s:.6} s, `{other}` \
         every {allowed_s:.6} s; allowed: all sensors at one rate (a reference or a thermometer \
         may have another)"
    )]
    OtherRate {
        /// The channel.
        column: String,
        /// A channel of the group chosen.
        other: String,
        /// Its step, s.
        found_s: f64,
        /// The step of the group chosen, s.
        allowed_s: f64,
    },
    /// Several channel groups have a channel over the same time.
    #[error(
        "column `{column}` is in the channel groups {groups} over the same time; allowed: one, \
         named as `group` of the channel under [recording.channels]"
    )]
    Ambiguous {
        /// The channel.
        column: String,
        /// Numbers of the groups, from 1.
        groups: String,
    },
    /// The layout asked for cannot be.
    #[error("cannot be read with [recording] {field} = {found}; allowed: {allowed}")]
    Layout {
        /// Field of the layout.
        field: &'static str,
        /// Its value.
        found: String,
        /// What it may be.
        allowed: &'static str,
    },
    /// A layout file that is no TOML, or has a field that is not known.
    #[error("line {line}: {found}")]
    LayoutFile {
        /// Line, from 1.
        line: usize,
        /// What its parser says, one line.
        found: String,
    },
    /// A Parquet or MDF4 file that is damaged or cut off.
    #[error("is not a whole {format} file: {found}")]
    Damaged {
        /// Name of the format.
        format: &'static str,
        /// What its decoder says, one line.
        found: String,
    },
}

/// The rate of a period (s), in Hz to 0.1 Hz.
fn hertz(period_s: f64) -> f64 {
    (10.0 / period_s).round() / 10.0
}

/// How rows off the clock can be read.
const RESAMPLE: &str = "`timing = \"resample\"` under [recording] brings rows onto the clock where \
     their times are exact";

/// What may be the matter where there is no time.
const NO_TIME: &str = " (of a text file `row_period_ms` under [recording] states the time from row to row, and \
     `skip_lines` the lines before its header)";

/// What the time may be.
pub(super) const FINITE_TIME: &str = "a finite number of the time unit";

/// What a channel may be where an infinity was found.
pub(super) const FINITE: &str = "a finite number";

/// What a channel may be where NaN was found.
pub(super) const NO_NAN: &str = "a number, or nothing where the sample is missing \
     (`written_nan = \"missing\"` under [recording] takes NaN as that)";

/// What counts may be that f64 holds to the last one.
pub(super) const WHOLE_COUNTS: &str = "counts below 2^53, beyond which they are not exact (record the counter modulo \
     its width, or from its first value on)";

/// Foreign text, fit for one line of a message: without control characters,
/// at most `limit` characters and then `…`.
pub(super) fn clipped(bytes: &[u8], limit: usize) -> String {
    let head = &bytes[..bytes.len().min(4 * limit)];
    let escaped = head.utf8_chunks().flat_map(|chunk| {
        let valid = chunk.valid().chars().map(|c| {
            if c.is_control() {
                c.escape_default().to_string()
            } else {
                c.to_string()
            }
        });
        let invalid = chunk.invalid().iter().map(|b| b.escape_ascii().to_string());
        valid.chain(invalid)
    });
    let mut text = String::new();
    for (taken, piece) in escaped.enumerate() {
        if taken == limit {
            return text + "…";
        }
        text += &piece;
    }
    if head.len() < bytes.len() {
        text.push('…');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn foreign_text_stays_on_one_line() {
        assert_eq!(clipped("µm/m".as_bytes(), 40), "µm/m");
        assert_eq!(clipped(b"a\nb\x1b\xff", 40), "a\\nb\\u{1b}\\xff");
        assert_eq!(clipped(&[b'x'; 1000], 40), "x".repeat(40) + "…");
        assert!(clipped(&[0; 1000], 40).len() < 400);
    }
}
