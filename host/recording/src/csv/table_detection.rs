//! Finds the table in a text file of unknown layout for `file_survey.rs`, and returns the layout by
//! which it can be read (`outline`): the usual one where the header stands at the top, else lines
//! to skip, delimiter, and name and unit of each column.

use std::path::Path;

use super::cell_kind::recognise;
use super::cells::Cells;
use super::dialect::DELIMITERS;
use super::header::separator;
use super::lines::Lines;
use super::number;
use crate::Unit;
use crate::error::Problem;
use crate::recording_layout::{ColumnType, CsvLayout};

/// Begins of comment lines that headers are found behind.
const COMMENTS: &[char] = &['%', '#', '/', '!', '*'];

/// A layout that reads the text in `path`: the usual one where the header stands at its top, else
/// with the lines before the table skipped and its columns named.
///
/// Columns without a name are called `column_2` and so on, by their place. `is_explicit`: names are
/// given even where the header is found.
pub(crate) fn outline(path: &Path, is_explicit: bool) -> Result<CsvLayout, Problem> {
    let mut lines = Lines::open(path, &CsvLayout::default())?;
    let preview = lines.preview()?;
    let lines: Vec<&[u8]> = preview
        .split(|&b| b == b'\n')
        .map(|line| line.strip_suffix(b"\r").unwrap_or(line))
        .collect();
    let tables = DELIMITERS
        .iter()
        .rev()
        .filter_map(|&d| Table::of(&lines, d));
    // Of equally good ones the last, which is the usual delimiter.
    let Some(table) = tables.max_by_key(|table| table.numbers) else {
        return Ok(CsvLayout::default());
    };
    let header = table.header(&lines);
    if header.as_ref().is_some_and(|header| header.is_at_the_top) && !is_explicit {
        return Ok(CsvLayout::default());
    }
    let columns = match header {
        Some(header) => header.columns,
        None => vec![String::new(); table.width],
    };
    Ok(CsvLayout {
        skip_lines: table.first as u32,
        delimiter: (table.delimiter != b',').then_some(char::from(table.delimiter)),
        columns: table.named(&lines, columns),
        ..CsvLayout::default()
    })
}

/// Rows at the end of a text.
struct Table {
    delimiter: u8,
    width: usize,
    /// Line of the first row, from 0.
    first: usize,
    /// Cells with numbers.
    numbers: usize,
}

struct Header {
    /// Name and unit of each column, `name [unit]`.
    columns: Vec<String>,
    /// Whether nothing but comments of the usual kind stands before it.
    is_at_the_top: bool,
}

fn cells(line: &[u8], delimiter: u8) -> Vec<Vec<u8>> {
    let mut found = Vec::new();
    Cells { delimiter }.each(line, |_, cell| found.push(cell.to_vec()));
    found
}

fn is_blank(line: &[u8]) -> bool {
    line.iter().all(u8::is_ascii_whitespace)
}

fn is_comment(line: &[u8]) -> bool {
    line.starts_with(b"#")
}

/// A number with a decimal point or comma.
fn number(cell: &[u8]) -> Option<f64> {
    number::parse(cell, false).or_else(|| number::parse(cell, true))
}

impl Table {
    /// The rows up to the end of `lines`: values alone, as many in each.
    fn of(lines: &[&[u8]], delimiter: u8) -> Option<Self> {
        let mut table: Option<Self> = None;
        for (i, line) in lines.iter().enumerate().rev() {
            if is_blank(line) || is_comment(line) {
                continue;
            }
            let row = cells(line, delimiter);
            let numbers = row.iter().filter(|cell| number(cell).is_some()).count();
            let is_value = |cell: &Vec<u8>| {
                cell.is_empty()
                    || number(cell).is_some()
                    || recognise(&[cell]) != ColumnType::Number
            };
            let width = table.as_ref().map_or(row.len(), |table| table.width);
            if row.len() != width || numbers == 0 || !row.iter().all(is_value) {
                break;
            }
            let before = table.map_or(0, |table| table.numbers);
            table = Some(Self {
                delimiter,
                width,
                first: i,
                numbers: before + numbers,
            });
        }
        table.filter(|table| table.width > 1)
    }

    /// The line of names above the rows, with a line of units below it where there is one.
    fn header(&self, lines: &[&[u8]]) -> Option<Header> {
        let above: Vec<usize> = (0..self.first)
            .rev()
            .filter(|i| !is_blank(lines[*i]))
            .collect();
        let texts = |at: usize| {
            let line = lines.get(*above.get(at)?)?;
            let text = String::from_utf8_lossy(line);
            let row = cells(text.trim_start_matches(COMMENTS).as_bytes(), self.delimiter);
            let row: Vec<String> = row
                .iter()
                .map(|cell| String::from_utf8_lossy(cell).into_owned())
                .collect();
            (row.len() == self.width).then_some(row)
        };
        let nearest = texts(0)?;
        let plain = |text: &str| text.trim_matches(['[', ']']).to_owned();
        let are_units = nearest
            .iter()
            .all(|t| t.is_empty() || plain(t).parse::<Unit>().is_ok());
        let (place, columns) = match texts(1).filter(|_| are_units) {
            Some(names) => {
                let with_unit = |(name, unit): (String, &String)| match plain(unit) {
                    unit if unit.is_empty() || name.ends_with(']') => name,
                    unit => format!("{name} [{unit}]"),
                };
                (1, names.into_iter().zip(&nearest).map(with_unit).collect())
            }
            None => (0, nearest),
        };
        let line = *above.get(place)?;
        let is_plain = |i: &usize| is_comment(lines[*i]) || separator(lines[*i]).is_some();
        Some(Header {
            columns,
            is_at_the_top: above[place + 1..].iter().all(is_plain)
                && !lines[line]
                    .first()
                    .is_some_and(|b| COMMENTS.contains(&char::from(*b))),
        })
    }

    /// The columns with a name each that no other has; the first is the time where it has no name
    /// and rises.
    fn named(&self, lines: &[&[u8]], columns: Vec<String>) -> Vec<String> {
        let first = lines[self.first..]
            .iter()
            .filter_map(|line| number(cells(line, self.delimiter).first()?));
        let first: Vec<f64> = first.collect();
        let rises = first.len() > 2 && first.windows(2).all(|pair| pair[1] > pair[0]);
        let mut named: Vec<String> = Vec::with_capacity(columns.len());
        for (i, text) in columns.into_iter().enumerate() {
            let unit = text.strip_prefix('[').or(text.strip_prefix(" ["));
            let is_bare = text.trim().is_empty() || unit.is_some();
            let name = match (is_bare, i) {
                (false, _) if !named.contains(&text) => text,
                (true, 0) if rises => format!("t {}", text.trim()).trim().to_owned(),
                _ => format!(
                    "column_{} {}",
                    i + 1,
                    if is_bare { text.trim() } else { "" }
                )
                .trim()
                .to_owned(),
            };
            named.push(name);
        }
        named
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(text: &str) -> CsvLayout {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("recording");
        std::fs::write(&path, text).unwrap();
        outline(&path, false).unwrap()
    }

    #[test]
    fn a_header_at_the_top_needs_no_setting() {
        for text in [
            "t [s],a [m]\n0,1\n1,2\n",
            "# comment\n\nt [s];a [m]\n0;1,5\n1;2\n",
            "sep=;\nt [s];a [m]\n0;1\n1;2\n",
            "t;a\ns;m\n0;1\n1;2\n",
            "time,on\n2026-03-31T12:00:00.002,true\n2026-03-31T12:00:00.004,false\n",
        ] {
            assert_eq!(found(text), CsvLayout::default(), "{text}");
        }
    }

    #[test]
    fn a_table_below_a_head_and_one_without_names() {
        let head = "Date:;2020-07-08\nScale:;0;True\n;Velocity;Torque\nms;rpm;%\n0.0;1;2\n40.0;1;2\n80.0;1;3\n";
        let layout = found(head);
        assert_eq!((layout.skip_lines, layout.delimiter), (4, Some(';')));
        assert_eq!(layout.columns, ["t [ms]", "Velocity [rpm]", "Torque [%]"]);

        let layout = found("%note\n%Time [ms], A [counts]\n0.000,1\n0.001,2\n");
        assert_eq!(layout.skip_lines, 2);
        assert_eq!(layout.columns, ["Time [ms]", "A [counts]"]);

        let layout = found("0.0,1,5\n0.1,1,4\n0.2,1,3\n");
        assert_eq!(layout.skip_lines, 0);
        assert_eq!(layout.columns, ["t", "column_2", "column_3"]);
    }
}
