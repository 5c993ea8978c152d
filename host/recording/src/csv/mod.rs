//! Reads recordings in text files, one row a sample, with cells at a delimiter (`Csv`), and
//! delivers the picked columns as blocks of rows in f64. A cell that does not suit its column is an
//! error with line and column; an empty one is a missing sample (NaN).
//!
//! A row is one line; quoted cells are understood, line ends inside quotes are
//! not. Only the columns asked for are parsed.
mod cell_kind;
mod cells;
mod dialect;
mod header;
mod lines;
mod number;
mod table_detection;

use std::path::Path;

use super::error::{FINITE, FINITE_TIME, NO_NAN, Problem, Row};
use super::recording_layout::{Column, CsvLayout, WrittenNan};
use super::row_source::{Output, Rows};
use super::{BLOCK_ROWS, TIME, shown};
pub(super) use cell_kind::Kind;
use cells::Cells;
use lines::Lines;
pub(super) use table_detection::outline;

pub(super) struct Csv {
    lines: Lines,
    format: Format,
    columns: Vec<Column>,
    /// `destination[i]`: where column `i` of the file goes.
    destination: Vec<Option<usize>>,
    rows: u64,
    /// Time from row to row where the file has no time (s).
    row_period_s: Option<f64>,
    /// What was recognised rather than stated, as settings.
    recognised: Vec<String>,
}

/// How a line becomes numbers.
struct Format {
    cells: Cells,
    comment: Vec<u8>,
    decimal_comma: bool,
    nan_is_missing: bool,
    /// Texts of missing samples.
    missing: Vec<Vec<u8>>,
    /// Kind of each column.
    kinds: Vec<Kind>,
}

impl Csv {
    pub(super) fn open(path: &Path, layout: &CsvLayout) -> Result<Self, Problem> {
        let mut lines = Lines::open(path, layout)?;
        let header = header::read(&mut lines, layout)?;
        let mut csv = Self {
            recognised: header.recognised,
            format: Format {
                cells: Cells {
                    delimiter: header.dialect.delimiter,
                },
                comment: layout.comment.as_bytes().to_vec(),
                decimal_comma: header.dialect.decimal_comma,
                nan_is_missing: layout.written_nan == WrittenNan::Missing,
                missing: (layout.missing.iter().map(|text| text.trim().into())).collect(),
                kinds: header.kinds,
            },
            lines,
            destination: vec![None; header.columns.len()],
            columns: header.columns,
            rows: 0,
            row_period_s: None,
        };
        if let Some(period) = layout.row_period_ms {
            let time = layout.column_of(TIME);
            if csv.columns.iter().any(|column| column.name == time) {
                return Err(Problem::Layout {
                    field: "row_period_ms",
                    found: format!("{period} beside the column `{}`", shown(time)),
                    allowed: "where no column is the time, in the header or in `columns`",
                });
            }
            csv.row_period_s = Some(period * 1e-3);
            csv.columns.push(Column::from_header("t [s]"));
        }
        Ok(csv)
    }

    pub(super) fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// What was recognised rather than stated; none where it is the usual.
    pub(super) fn note(&self) -> Option<String> {
        (!self.recognised.is_empty()).then(|| {
            format!(
                "read with {} (recognised; the same fields under [recording] state it)",
                self.recognised.join(", ")
            )
        })
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
            if is_comment_or_blank(line, &self.format.comment) {
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

/// What is wrong with a line, before it is known which line it is.
enum Flaw {
    Length(usize),
    Cell {
        column: usize,
        found: Vec<u8>,
        allowed: &'static str,
    },
}

fn is_comment_or_blank(line: &[u8], comment: &[u8]) -> bool {
    (!comment.is_empty() && line.starts_with(comment)) || line.iter().all(u8::is_ascii_whitespace)
}

impl Format {
    /// Appends the line's numbers to the columns that they belong to.
    fn parse(
        &self,
        line: &[u8],
        destination: &[Option<usize>],
        rows: &mut Rows,
    ) -> Result<(), Flaw> {
        let mut flaw = None;
        let count = self.cells.each(line, |column, cell| {
            if let Some(&Some(k)) = destination.get(column) {
                match self.value(column, cell, k == Rows::TIME) {
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

    /// The value of a cell of `column`; NaN where the sample is missing.
    fn value(&self, column: usize, cell: &[u8], is_time: bool) -> Result<f64, &'static str> {
        if !is_time && self.missing.iter().any(|text| text == cell) {
            return Ok(f64::NAN);
        }
        let kind = self.kinds.get(column).unwrap_or(&Kind::Number);
        match kind.value(cell, self.decimal_comma) {
            Some(value) if value.is_finite() => Ok(value),
            None if matches!(kind, Kind::Number) && number::is_grouped(cell) => {
                Err("a number without separators between thousands")
            }
            None if cell.contains(&b',') && matches!(kind, Kind::Number) => Err(
                "a number with a decimal point (`decimal_comma = true` under [recording] reads \
                 decimal commas)",
            ),
            _ if is_time && matches!(kind, Kind::Number) => Err(FINITE_TIME),
            None if cell.is_empty() && !is_time => Ok(f64::NAN),
            Some(value) if value.is_nan() => {
                if self.nan_is_missing {
                    Ok(f64::NAN)
                } else {
                    Err(NO_NAN)
                }
            }
            Some(_) => Err(FINITE),
            None => Err(kind.allowed()),
        }
    }
}
