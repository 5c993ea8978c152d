//! Determines the delimiter and the decimal sign of a text file (`Dialect`), as the layout or a
//! line `sep=;` states. Otherwise it is the delimiter that gives most numbers in the first rows,
//! and a decimal comma where these have commas and no points.
use crate::error::Problem;
use crate::recording_layout::CsvLayout;
use crate::shown;

use super::cells::Cells;
use super::number;

/// Delimiters that are recognised, the usual one first.
pub(super) const DELIMITERS: [u8; 4] = [b',', b';', b'\t', b'|'];

/// Rows by which the delimiter is recognised.
const ROWS: usize = 50;

/// Delimiter and decimal sign of a text.
pub(super) struct Dialect {
    pub(super) delimiter: u8,
    pub(super) decimal_comma: bool,
}

impl Dialect {
    /// As `layout` says it, else as `lines` show it: the header, where the file
    /// has one, and rows; comments and blank lines are not among them.
    /// `stated_by_file` is the delimiter of a line `sep=;`.
    pub(super) fn of(
        layout: &CsvLayout,
        stated_by_file: Option<u8>,
        lines: &[&[u8]],
    ) -> Result<Self, Problem> {
        let rows = if layout.columns.is_empty() {
            lines.get(1..).unwrap_or(&[])
        } else {
            lines
        };
        let delimiter = match layout.delimiter {
            Some(delimiter) => checked(delimiter)?,
            None => match stated_by_file {
                Some(delimiter) => checked(char::from(delimiter))?,
                None => delimiter(layout, lines, rows),
            },
        };
        let decimal_comma = match layout.decimal_comma {
            Some(true) if delimiter == b',' => {
                return Err(Problem::Layout {
                    field: "decimal_comma",
                    found: "true".into(),
                    allowed: "only with another `delimiter` than the comma",
                });
            }
            Some(decimal_comma) => decimal_comma,
            None => delimiter != b',' && has_decimal_comma(rows, delimiter)?,
        };
        Ok(Self {
            delimiter,
            decimal_comma,
        })
    }
}

/// A delimiter that may be one.
fn checked(delimiter: char) -> Result<u8, Problem> {
    u8::try_from(delimiter)
        .ok()
        .filter(|d| d.is_ascii() && !d.is_ascii_alphanumeric() && !b"\"\r\n.+-".contains(d))
        .ok_or_else(|| Problem::Layout {
            field: "delimiter",
            found: format!("{delimiter:?}"),
            allowed: "one ASCII character such as `,`, `;` or a tab, that no number contains",
        })
}

/// The delimiter that divides the rows into as many cells as the header, with
/// the most numbers among them; the comma where none does.
fn delimiter(layout: &CsvLayout, lines: &[&[u8]], rows: &[&[u8]]) -> u8 {
    let numbers = |delimiter: u8| {
        let cells = Cells { delimiter };
        let columns = match layout.columns.len() {
            0 => cells.each(lines.first()?, |_, _| ()),
            stated => stated,
        };
        let mut found = 0;
        for row in rows.iter().take(ROWS) {
            let mut here = 0;
            let count = cells.each(row, |_, cell| {
                here += usize::from(is_number(cell, delimiter != b','));
            });
            found += if count == columns { here } else { 0 };
        }
        (columns > 1).then_some((found, columns))
    };
    DELIMITERS
        .into_iter()
        .rev()
        .filter_map(|delimiter| Some((numbers(delimiter)?, delimiter)))
        // Of equally good ones the last, which is the usual one.
        .max_by_key(|(numbers, _)| *numbers)
        .map_or(b',', |(_, delimiter)| delimiter)
}

fn is_number(cell: &[u8], may_have_comma: bool) -> bool {
    number::parse(cell, false).is_some() || (may_have_comma && number::parse(cell, true).is_some())
}

/// Whether numbers have commas and none has a point.
///
/// # Errors
/// [`Problem::CommaMeaning`] where each comma may stand between thousands as well.
fn has_decimal_comma(rows: &[&[u8]], delimiter: u8) -> Result<bool, Problem> {
    let (mut commas, mut points) = (0, 0);
    let (mut thousands, mut one) = (0, Vec::new());
    for row in rows {
        Cells { delimiter }.each(row, |_, cell| {
            if cell.contains(&b',') {
                commas += usize::from(number::parse(cell, true).is_some());
                if number::may_be_thousands(cell) {
                    thousands += 1;
                    one = cell.to_vec();
                }
            } else if cell.contains(&b'.') {
                points += usize::from(number::parse(cell, false).is_some());
            }
        });
    }
    if commas > 0 && points == 0 && thousands == commas {
        return Err(Problem::CommaMeaning { found: shown(&one) });
    }
    Ok(commas > 0 && points == 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dialect(text: &str, layout: &str) -> (char, bool) {
        let lines: Vec<&[u8]> = text.lines().map(str::as_bytes).collect();
        let found = Dialect::of(&toml::from_str(layout).unwrap(), None, &lines).unwrap();
        (found.delimiter.into(), found.decimal_comma)
    }

    #[test]
    fn delimiter_and_decimal_sign_by_the_first_rows() {
        for (text, expected) in [
            ("t [s],a [m]\n0,1\n0.5,2", (',', false)),
            ("t [s];a [m]\n0;1\n0,5;2", (';', true)),
            ("t [s];a [m]\n0;1\n0.5;2", (';', false)),
            ("t [s]\ta [m]\n0\t1,5\n0,5\t2", ('\t', true)),
            ("t [s]|a [m]\n0|1\n0.5|2", ('|', false)),
            // Commas in names, and thousands beside decimals.
            ("t [s];torque, main [Nm]\n0;1\n0.5;2", (';', false)),
            ("t [s];a [m]\n0.5;1,000\n1;2", (';', false)),
            ("\"t [s]\";\"a; b [m]\"\n0,5;1\n1;2", (';', true)),
            ("t [s]\n0\n1", (',', false)),
            ("", (',', false)),
        ] {
            assert_eq!(dialect(text, ""), expected, "{text}");
        }
    }

    #[test]
    fn a_comma_before_three_digits_is_not_guessed() {
        let head = "t [ms];a [Nm];b [Nm]\n";
        let of = |rows: &str, layout: &str| {
            let text = format!("{head}{rows}");
            let lines: Vec<&[u8]> = text.lines().map(str::as_bytes).collect();
            Dialect::of(&toml::from_str(layout).unwrap(), None, &lines).map(|d| d.decimal_comma)
        };
        for rows in ["0;312,031;\n2;-1,994;5", "0;;10,000\n1;999;"] {
            let found = of(rows, "");
            assert!(matches!(found, Err(Problem::CommaMeaning { .. })), "{rows}");
            assert_eq!(of(rows, "decimal_comma = true").ok(), Some(true));
            assert_eq!(of(rows, "decimal_comma = false").ok(), Some(false));
        }
        // One that is no separator shows what the others are.
        for decisive in ["0,002", "1,5", "1234,567", "-0,125", "1,2345"] {
            let rows = format!("0;312,031;\n2;{decisive};5");
            assert_eq!(of(&rows, "").ok(), Some(true), "{decisive}");
        }
        assert_eq!(of("0.5;312,031;\n2;311,994;5", "").ok(), Some(false));
    }

    #[test]
    fn what_the_layout_says_holds() {
        let text = "0;1,5\n0,5;2";
        let columns = "columns = ['t [s]', 'a [m]']";
        assert_eq!(dialect(text, columns), (';', true));
        let stated = "decimal_comma = false\n".to_owned() + columns;
        assert_eq!(dialect(text, &stated), (';', false));
        assert_eq!(dialect(text, "delimiter = ','"), (',', false));
    }
}
