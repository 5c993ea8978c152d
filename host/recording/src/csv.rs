//! Recordings as text: delimiter-separated columns, one row a sample.
//!
//! A row is one line; quoted cells are understood, line ends inside quotes are
//! not. Only the columns asked for are parsed.
use std::fs::File;
use std::io::Read;
use std::ops::Range;
use std::path::Path;

use super::error::{FINITE, FINITE_TIME, NO_NAN, Problem, Row};
use super::layout::{Column, CsvLayout, WrittenNan};
use super::source::{Output, Rows};
use super::{BLOCK_ROWS, shown};

/// Size of the read buffer and so the longest line: what is longer is no CSV.
const BUFFER: usize = 1 << 20;

pub(super) struct Csv {
    lines: Lines,
    format: Format,
    columns: Vec<Column>,
    /// `destination[i]`: where column `i` of the file goes.
    destination: Vec<Option<usize>>,
    rows: u64,
    /// Time from row to row where the file has no time [s].
    row_period_s: Option<f64>,
}

/// How a line becomes numbers.
struct Format {
    delimiter: u8,
    comment: Vec<u8>,
    decimal_comma: bool,
    nan_is_missing: bool,
}

impl Csv {
    pub(super) fn open(path: &Path, layout: &CsvLayout) -> Result<Self, Problem> {
        let format = Format::try_new(layout)?;
        let mut lines = Lines::open(path)?;
        for _ in 0..layout.skip_lines {
            lines.next()?.ok_or(Problem::Empty)?;
        }
        let columns = if layout.columns.is_empty() {
            read_header(&mut lines, &format)?
        } else {
            layout
                .columns
                .iter()
                .map(|c| Column::from_header(c))
                .collect()
        };
        let mut csv = Self {
            lines,
            format,
            destination: vec![None; columns.len()],
            columns,
            rows: 0,
            row_period_s: None,
        };
        if let Some(period) = layout.row_period_ms {
            csv.row_period_s = Some(period * 1e-3);
            csv.columns.push(Column::from_header("t [s]"));
        }
        Ok(csv)
    }

    pub(super) fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Delivers all rows; column `picks[k]` of the file becomes their column `k`.
    pub(super) fn run(mut self, picks: &[usize], output: &Output) -> Result<(), Problem> {
        for (k, &column) in picks.iter().enumerate() {
            // The time that the file lacks is behind its last column.
            if let Some(destination) = self.destination.get_mut(column) {
                *destination = Some(k);
            }
        }
        loop {
            let mut rows = Rows::with_columns(picks.len());
            self.read(&mut rows)?;
            let last = rows.lines.len() < BLOCK_ROWS;
            if !output.deliver(rows, self.lines.progress()) || last {
                return Ok(());
            }
        }
    }

    /// Appends rows up to a whole block; fewer only at the end of the file.
    fn read(&mut self, rows: &mut Rows) -> Result<(), Problem> {
        while rows.lines.len() < BLOCK_ROWS {
            let Some(range) = self.lines.next()? else {
                return Ok(());
            };
            let line = &self.lines.buffer[range];
            if self.format.is_comment_or_blank(line) {
                continue;
            }
            self.rows += 1;
            let place = Row {
                row: self.rows,
                line: Some(self.lines.number),
            };
            rows.lines.push(self.lines.number);
            if let Some(period) = self.row_period_s {
                rows.columns[Rows::TIME].push((self.rows - 1) as f64 * period);
            }
            if let Err(problem) = self.format.parse(line, &self.destination, rows) {
                return Err(match problem {
                    Flaw::Length(found) => Problem::RowLength {
                        row: place,
                        found,
                        allowed: self.destination.len(),
                        last: self.lines.at_end(),
                    },
                    Flaw::Cell {
                        column,
                        found,
                        allowed,
                    } => Problem::Cell {
                        row: place,
                        column: shown(&self.columns[column].name),
                        found: shown(&found),
                        allowed,
                    },
                });
            }
        }
        Ok(())
    }
}

fn read_header(lines: &mut Lines, format: &Format) -> Result<Vec<Column>, Problem> {
    let line = loop {
        let range = lines.next()?.ok_or(Problem::Empty)?;
        if !format.is_comment_or_blank(&lines.buffer[range.clone()]) {
            break &lines.buffer[range];
        }
    };
    let Ok(text) = std::str::from_utf8(line) else {
        return Err(Problem::NotText {
            line: lines.number,
            found: shown(line),
        });
    };
    if text.contains('\0') {
        return Err(Problem::NotText {
            line: lines.number,
            found: shown(line),
        });
    }
    let mut columns = Vec::new();
    format.cells(line, |_, cell| {
        columns.push(Column::from_header(&String::from_utf8_lossy(cell)));
    });
    match columns.first() {
        Some(first) if columns.iter().all(|c| c.name.parse::<f64>().is_ok()) => {
            Err(Problem::NoHeader {
                line: lines.number,
                found: shown(&first.name),
            })
        }
        _ => Ok(columns),
    }
}

/// What is wrong with a line, before it is known which line it is.
enum Flaw {
    Length(usize),
    Cell {
        column: usize,
        found: Vec<u8>,
        allowed: &'static str,
    },
}

impl Format {
    fn try_new(layout: &CsvLayout) -> Result<Self, Problem> {
        let delimiter = u8::try_from(layout.delimiter)
            .ok()
            .filter(|d| d.is_ascii() && !d.is_ascii_alphanumeric() && !b"\"\r\n.+-".contains(d))
            .ok_or_else(|| Problem::Layout {
                field: "delimiter",
                found: format!("{:?}", layout.delimiter),
                allowed: "one ASCII character such as `,`, `;` or a tab, that no number contains",
            })?;
        if layout.decimal_comma && delimiter == b',' {
            return Err(Problem::Layout {
                field: "decimal_comma",
                found: "true".into(),
                allowed: "only with another `delimiter` than the comma",
            });
        }
        Ok(Self {
            delimiter,
            comment: layout.comment.as_bytes().to_vec(),
            decimal_comma: layout.decimal_comma,
            nan_is_missing: layout.written_nan == WrittenNan::Missing,
        })
    }

    fn is_comment_or_blank(&self, line: &[u8]) -> bool {
        (!self.comment.is_empty() && line.starts_with(&self.comment))
            || line.iter().all(u8::is_ascii_whitespace)
    }

    /// Calls `each` with every cell, trimmed and unquoted; returns their number.
    fn cells(&self, line: &[u8], mut each: impl FnMut(usize, &[u8])) -> usize {
        if memchr::memchr(b'"', line).is_some() {
            return self.quoted_cells(line, each);
        }
        let (mut start, mut count) = (0, 0);
        for end in memchr::memchr_iter(self.delimiter, line) {
            each(count, line[start..end].trim_ascii());
            start = end + 1;
            count += 1;
        }
        each(count, line[start..].trim_ascii());
        count + 1
    }

    #[cold]
    fn quoted_cells(&self, line: &[u8], mut each: impl FnMut(usize, &[u8])) -> usize {
        let mut record = csv::ByteRecord::new();
        // One line of memory cannot fail to be read, and has one record at
        // most; where it has none there are no cells.
        let _ = csv::ReaderBuilder::new()
            .delimiter(self.delimiter)
            .has_headers(false)
            .trim(csv::Trim::All)
            .from_reader(line)
            .read_byte_record(&mut record);
        for (i, cell) in record.iter().enumerate() {
            each(i, cell);
        }
        record.len()
    }

    /// Appends the line's numbers to the columns that they belong to.
    fn parse(
        &self,
        line: &[u8],
        destination: &[Option<usize>],
        rows: &mut Rows,
    ) -> Result<(), Flaw> {
        let mut flaw = None;
        let count = self.cells(line, |column, cell| {
            if let Some(&Some(k)) = destination.get(column) {
                match self.number(cell, k == Rows::TIME) {
                    Ok(value) => rows.columns[k].push(value),
                    Err(allowed) => {
                        flaw.get_or_insert_with(|| Flaw::Cell {
                            column,
                            found: cell.to_vec(),
                            allowed,
                        });
                    }
                }
            }
        });
        // A row that is cut off in the middle of a cell is too short first.
        if count != destination.len() {
            return Err(Flaw::Length(count));
        }
        flaw.map_or(Ok(()), Err)
    }

    /// The number in a cell; NaN where the sample is missing.
    fn number(&self, cell: &[u8], is_time: bool) -> Result<f64, &'static str> {
        let parsed = if self.decimal_comma {
            parse_decimal_comma(cell)
        } else {
            parse_number(cell)
        };
        match parsed {
            Some(value) if value.is_finite() => Ok(value),
            _ if is_time => Err(FINITE_TIME),
            None if cell.is_empty() => Ok(f64::NAN),
            Some(value) if value.is_nan() => {
                if self.nan_is_missing {
                    Ok(f64::NAN)
                } else {
                    Err(NO_NAN)
                }
            }
            Some(_) => Err(FINITE),
            None => Err("a number, or nothing where the sample is missing"),
        }
    }
}

fn parse_number(cell: &[u8]) -> Option<f64> {
    parse_short(cell).or_else(|| std::str::from_utf8(cell).ok()?.parse().ok())
}

/// A plain decimal of at most 15 digits, such as recorders write: its digits as
/// an integer and the power of ten are exact in f64, so that one division
/// rounds as the full parser does, in a third of the time.
///
/// Source: Clinger 1990, How to read floating point numbers accurately.
fn parse_short(cell: &[u8]) -> Option<f64> {
    const POWERS: [f64; 16] = [
        1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15,
    ];
    let (negative, digits) = match cell {
        [b'-', rest @ ..] => (true, rest),
        rest => (false, rest),
    };
    // 15 digits and the point.
    if digits.is_empty() || digits.len() > 16 {
        return None;
    }
    let mut whole = 0_u64;
    let mut point = None;
    for (i, &byte) in digits.iter().enumerate() {
        let digit = byte.wrapping_sub(b'0');
        if digit <= 9 {
            whole = whole * 10 + u64::from(digit);
        } else if byte == b'.' && point.is_none() {
            point = Some(i);
        } else {
            return None;
        }
    }
    let decimals = match point {
        Some(i) if digits.len() > 1 => digits.len() - 1 - i,
        None if digits.len() < 16 => 0,
        _ => return None,
    };
    let value = whole as f64 / POWERS[decimals];
    Some(if negative { -value } else { value })
}

fn parse_decimal_comma(cell: &[u8]) -> Option<f64> {
    if cell.contains(&b'.') {
        return None;
    }
    // Longer than any number that a recorder writes.
    let mut copy = [0; 64];
    let copy = copy.get_mut(..cell.len())?;
    copy.copy_from_slice(cell);
    if let Some(comma) = copy.iter().position(|&b| b == b',') {
        copy[comma] = b'.';
    }
    parse_number(copy)
}

/// Lines of a file in a buffer of fixed size.
struct Lines {
    file: File,
    length: u64,
    buffer: Vec<u8>,
    /// Bytes of the buffer that hold text not yet handed out.
    unread: Range<usize>,
    /// Bytes taken from the file.
    taken: u64,
    ended: bool,
    /// Number of the line handed out last, from 1.
    number: u64,
}

impl Lines {
    fn open(path: &Path) -> Result<Self, Problem> {
        let file = File::open(path)?;
        let mut lines = Self {
            length: file.metadata()?.len(),
            file,
            buffer: vec![0; BUFFER],
            unread: 0..0,
            taken: 0,
            ended: false,
            number: 0,
        };
        lines.fill()?;
        if lines.buffer[lines.unread.clone()].starts_with(b"\xef\xbb\xbf") {
            lines.unread.start += 3;
        }
        Ok(lines)
    }

    /// Moves what is unread to the front and reads on behind it.
    fn fill(&mut self) -> Result<(), Problem> {
        self.buffer.copy_within(self.unread.clone(), 0);
        self.unread = 0..self.unread.len();
        loop {
            match self.file.read(&mut self.buffer[self.unread.end..]) {
                Ok(count) => {
                    self.unread.end += count;
                    self.taken += count as u64;
                    self.ended = count == 0;
                    return Ok(());
                }
                Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
                Err(e) => return Err(e.into()),
            }
        }
    }

    /// The next line without its end, as a range of the buffer.
    fn next(&mut self) -> Result<Option<Range<usize>>, Problem> {
        let mut searched = 0;
        let (length, end) = loop {
            let unread = &self.buffer[self.unread.clone()];
            if let Some(length) = memchr::memchr(b'\n', &unread[searched..]) {
                break (searched + length, 1);
            }
            searched = unread.len();
            if self.ended {
                if searched == 0 {
                    return Ok(None);
                }
                break (searched, 0);
            }
            if searched == BUFFER {
                return Err(Problem::LineTooLong {
                    line: self.number + 1,
                    limit: BUFFER,
                });
            }
            self.fill()?;
        };
        self.number += 1;
        let start = self.unread.start;
        let line = &self.buffer[start..start + length];
        let without_return = line.strip_suffix(b"\r").unwrap_or(line).len();
        self.unread.start += length + end;
        Ok(Some(start..start + without_return))
    }

    fn at_end(&mut self) -> bool {
        if self.unread.is_empty() && !self.ended {
            // An error to read shows again when the next line is asked for.
            let _ = self.fill();
        }
        self.unread.is_empty()
    }

    fn progress(&self) -> f64 {
        let used = self.taken.saturating_sub(self.unread.len() as u64);
        (used as f64 / self.length.max(1) as f64).min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimal_comma() {
        assert_eq!(parse_decimal_comma(b"-1,25e-3"), Some(-1.25e-3));
        assert_eq!(parse_decimal_comma(b"1.5"), None);
        assert_eq!(parse_decimal_comma(b"1,000,5"), None);
        assert_eq!(parse_decimal_comma(&[b'1'; 100]), None);
    }

    proptest::proptest! {
        #[test]
        fn short_decimals_are_those_of_the_full_parser(
            text in "-?[0-9]{0,9}\\.?[0-9]{0,9}|[-+.0-9e]{0,6}"
        ) {
            let full = text.parse::<f64>().ok().map(f64::to_bits);
            if let Some(value) = parse_short(text.as_bytes()) {
                proptest::prop_assert_eq!(Some(value.to_bits()), full, "{}", text);
            }
            proptest::prop_assert_eq!(parse_number(text.as_bytes()).map(f64::to_bits), full);
        }
    }

    #[test]
    fn quoted_and_plain_cells_are_the_same() {
        let format = Format::try_new(&CsvLayout::default()).unwrap();
        for line in [&b"1, 2 ,,x"[..], b"\"1\",\" 2 \",,\"x\""] {
            let mut cells = Vec::new();
            assert_eq!(format.cells(line, |_, c| cells.push(c.to_vec())), 4);
            assert_eq!(cells, [&b"1"[..], b"2", b"", b"x"]);
        }
    }
}
