//! How a recording is laid out, as the machine description says it.
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::error::Problem;
use super::unit::Unit;

/// Layout of a recording, the table `[recording]` of a machine description.
///
/// The defaults read what `loadtwin` writes: comma-separated, `#` comments, a
/// header `t [s],ta1 [µm/m],...`. Only the text format needs the first five
/// fields; the other two hold for Parquet and MDF4 as well.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CsvLayout {
    /// Separator of the columns: one ASCII character, `,` unless given.
    pub delimiter: char,
    /// A line that begins with this is a comment: `#` unless given.
    pub comment: String,
    /// Lines to leave out at the top of the file, comments included. Where
    /// `columns` is given, the file's own header lines belong to them.
    pub skip_lines: u32,
    /// Names and units of the columns, each `name [unit]`, for files without
    /// such a header. The time is `t`. An empty name leaves a column out.
    pub columns: Vec<String>,
    /// Numbers have a decimal comma: `1,5`. Needs another `delimiter`.
    pub decimal_comma: bool,
    /// What a `NaN` written in a channel means. An empty cell (in Parquet a
    /// null) is always a missing sample.
    pub written_nan: WrittenNan,
    /// Samples in a row that may be absent from the file: 0 unless given. They
    /// are put in as rows without values, and the estimator flags them; a
    /// longer gap is an error.
    pub largest_gap: u32,
    /// Time from row to row [ms], above 0 up to 3.6e6, for text files without a time
    /// column, such as 0.5 at 2 kHz; `columns` then names none. Absent unless given.
    pub row_period_ms: Option<f64>,
    /// What the times of the rows are: `clocked` unless given.
    pub timing: Timing,
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
            delimiter: ',',
            comment: "#".into(),
            skip_lines: 0,
            columns: Vec::new(),
            decimal_comma: false,
            written_nan: WrittenNan::Refuse,
            largest_gap: 0,
            row_period_ms: None,
            timing: Timing::Clocked,
        }
    }
}

impl CsvLayout {
    /// Refuses a row period that is no time.
    pub(super) fn check(&self) -> Result<(), Problem> {
        match self.row_period_ms {
            Some(ms) if !(ms > 0.0 && ms <= 3.6e6) => Err(Problem::Layout {
                field: "row_period_ms",
                found: ms.to_string(),
                allowed: "above 0, up to 3600000",
            }),
            _ => Ok(()),
        }
    }
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
        let split = text
            .strip_suffix(']')
            .and_then(|rest| rest.rsplit_once('['))
            .filter(|(name, _)| !name.trim().is_empty());
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
        assert_eq!((layout.delimiter, layout.largest_gap), (';', 2));
    }
}
