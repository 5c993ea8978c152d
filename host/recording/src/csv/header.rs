//! Reads all lines of a text file before its first row of values (`Header`): skipped lines,
//! `sep=;`, names and units of the columns. Also determines the delimiter and, by the first 50
//! rows, the kind of each column.
use crate::channel_names::name_time;
use crate::error::Problem;
use crate::recording_layout::{Column, CsvLayout};
use crate::{Unit, shown};

use super::cell_kind::{Kind, recognise};
use super::cells::Cells;
use super::dialect::Dialect;
use super::lines::Lines;
use super::{is_comment_or_blank, number};

/// The columns of a text and how its rows are read.
pub(super) struct Header {
    pub(super) dialect: Dialect,
    pub(super) columns: Vec<Column>,
    pub(super) kinds: Vec<Kind>,
    /// What was recognised and is not the usual, as settings.
    pub(super) recognised: Vec<String>,
}

/// Takes all lines before the first row.
pub(super) fn read(lines: &mut Lines, layout: &CsvLayout) -> Result<Header, Problem> {
    let mut stated_by_file = None;
    for i in 0..layout.skip_lines {
        let range = lines.next()?.ok_or(Problem::Empty)?;
        if i == 0 {
            stated_by_file = separator(&lines.buffer[range]);
        }
    }
    if layout.skip_lines == 0 {
        stated_by_file = first_line(lines.preview()?).and_then(separator);
        if stated_by_file.is_some() {
            lines.next()?;
        }
    }
    let preview = lines.preview()?;
    let ahead: Vec<&[u8]> = preview
        .split(|&b| b == b'\n')
        .map(|line| line.strip_suffix(b"\r").unwrap_or(line))
        .filter(|line| !is_comment_or_blank(line, layout.comment.as_bytes()))
        .collect();
    let dialect = Dialect::of(layout, stated_by_file, &ahead)?;
    let cells = Cells {
        delimiter: dialect.delimiter,
    };
    let mut columns: Vec<Column> = layout
        .columns
        .iter()
        .map(|text| Column::from_header(text))
        .collect();
    let mut rows = ahead.as_slice();
    let mut heading = 0;
    if columns.is_empty() {
        columns = names(rows.first().copied(), cells);
        rows = rows.get(1..).unwrap_or(&[]);
        heading = 1;
        if let Some(units) = rows.first().and_then(|row| units(row, cells, &columns)) {
            for (column, unit) in columns.iter_mut().zip(units) {
                column.unit = unit;
            }
            rows = &rows[1..];
            heading = 2;
        }
    }
    let kinds = kinds(rows, cells, &mut columns, layout);
    let recognised = recognised(lines.recognised, &dialect, stated_by_file, layout);
    take(lines, heading, layout, dialect.decimal_comma, &columns)?;
    Ok(Header {
        dialect,
        columns,
        kinds,
        recognised,
    })
}

fn first_line(text: &[u8]) -> Option<&[u8]> {
    text.split(|&b| b == b'\n').next()
}

/// The delimiter of Excel's line `sep=;`.
pub(super) fn separator(line: &[u8]) -> Option<u8> {
    let line = line.strip_suffix(b"\r").unwrap_or(line);
    let plain = line.strip_prefix(b"\"").unwrap_or(line);
    match plain {
        [s, e, p, b'=', delimiter, rest @ ..]
            if [*s, *e, *p].eq_ignore_ascii_case(b"sep") && matches!(rest, [] | [b'"']) =>
        {
            Some(*delimiter)
        }
        _ => None,
    }
}

fn names(line: Option<&[u8]>, cells: Cells) -> Vec<Column> {
    let mut columns = Vec::new();
    cells.each(line.unwrap_or_default(), |_, cell| {
        columns.push(Column::from_header(&String::from_utf8_lossy(cell)));
    });
    columns
}

/// The units in a second line of the header, where the names have none: `s;µm/m;`.
fn units(line: &[u8], cells: Cells, columns: &[Column]) -> Option<Vec<Option<String>>> {
    if columns.iter().any(|column| column.unit.is_some()) {
        return None;
    }
    let mut units = Vec::new();
    let mut words = 0;
    let mut all = true;
    let count = cells.each(line, |_, cell| {
        let text = String::from_utf8_lossy(cell);
        let plain = text.strip_prefix('[').and_then(|t| t.strip_suffix(']'));
        let plain = plain.unwrap_or(&text);
        all &= plain.is_empty() || plain.parse::<Unit>().is_ok();
        words += usize::from(!plain.is_empty() && number::parse(cell, true).is_none());
        units.push((!plain.is_empty()).then(|| plain.to_owned()));
    });
    (all && words > 0 && count == columns.len()).then_some(units)
}

/// The kind of each column: as the layout says it, else by the first rows. A kind that fixes the
/// unit writes it into the column.
fn kinds(rows: &[&[u8]], cells: Cells, columns: &mut [Column], layout: &CsvLayout) -> Vec<Kind> {
    let mut table: Vec<Vec<&[u8]>> = vec![Vec::new(); columns.len()];
    let mut owned: Vec<(usize, Vec<u8>)> = Vec::new();
    for row in rows.iter().take(50) {
        cells.each(row, |i, cell| {
            if !cell.is_empty() && i < columns.len() {
                owned.push((i, cell.to_vec()));
            }
        });
    }
    for (i, cell) in &owned {
        table[*i].push(cell);
    }
    let mut timed = columns.to_vec();
    name_time(&mut timed);
    let kind = |((column, timed), cells): ((&mut Column, &Column), &Vec<&[u8]>)| {
        let stated = layout
            .layout_of_column(&column.name)
            .or(layout.layout_of_column(&timed.name));
        let kind = stated
            .and_then(|channel| channel.kind)
            .unwrap_or_else(|| recognise(cells));
        let kind = Kind::of(kind, stated);
        match kind.unit() {
            Some(unit) if kind.is_time() || column.unit.is_none() => {
                column.unit = Some(unit.into());
            }
            _ => {}
        }
        kind
    };
    columns
        .iter_mut()
        .zip(&timed)
        .zip(&table)
        .map(kind)
        .collect()
}

/// What was recognised and is not the usual, as settings of the layout.
fn recognised(
    encoding: Option<&'static str>,
    dialect: &Dialect,
    stated_by_file: Option<u8>,
    layout: &CsvLayout,
) -> Vec<String> {
    let mut settings = Vec::new();
    if dialect.delimiter != b',' && layout.delimiter.is_none() && stated_by_file.is_none() {
        settings.push(format!(
            "delimiter = {:?}",
            char::from(dialect.delimiter).to_string()
        ));
    }
    if dialect.decimal_comma && layout.decimal_comma.is_none() {
        settings.push("decimal_comma = true".into());
    }
    if let Some(encoding) = encoding {
        settings.push(format!("encoding = {:?}", encoding.to_ascii_lowercase()));
    }
    settings
}

/// Takes the `heading` lines of the header and refuses what is none.
fn take(
    lines: &mut Lines,
    heading: usize,
    layout: &CsvLayout,
    decimal_comma: bool,
    columns: &[Column],
) -> Result<(), Problem> {
    for i in 0..heading {
        let line = loop {
            let range = lines.next()?.ok_or(Problem::Empty)?;
            if !is_comment_or_blank(&lines.buffer[range.clone()], layout.comment.as_bytes()) {
                break &lines.buffer[range];
            }
        };
        if i > 0 {
            continue;
        }
        if line.contains(&b'\r') && !line.contains(&0) {
            return Err(Problem::CarriageReturns);
        }
        let is_text = |text: &str| !text.chars().any(|c| c.is_control() && c != '\t');
        if !std::str::from_utf8(line).is_ok_and(is_text) {
            return Err(Problem::NotText {
                line: lines.number,
                found: shown(line),
            });
        }
        let is_number = |c: &&Column| number::parse(c.name.as_bytes(), decimal_comma).is_some();
        let is_row = columns.iter().all(|c| c.name.is_empty() || is_number(&c));
        if let Some(first) = columns.iter().find(is_number).filter(|_| is_row) {
            return Err(Problem::NoHeader {
                line: lines.number,
                found: shown(&first.name),
            });
        }
    }
    Ok(())
}

impl Kind {
    /// Whether its values are seconds, whatever unit the file states.
    fn is_time(&self) -> bool {
        self.unit() == Some("s")
    }
}
