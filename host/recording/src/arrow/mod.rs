//! Converts Arrow record batches to blocks of rows in f64, for Parquet files and Arrow streams
//! (`ArrowTable`). The unit of a column comes from the metadata of its field, its name or its type;
//! null is a missing sample (NaN); a time that is not finite is an error.
mod batches;
mod values;

use arrow_array::{Array, ArrayRef, RecordBatch};
use arrow_schema::{Field, Schema};

use super::csv::Kind;
use super::error::{FINITE, FINITE_TIME, NO_NAN};
use super::error::{Problem, Row};
use super::recording_layout::{Column, CsvLayout, WrittenNan};
use super::row_source::{Output, Rows};
use super::{BLOCK_ROWS, shown};
pub(crate) use batches::ArrowStream;
pub use batches::Batches;
pub(crate) use values::{Since, is_number};
use values::{Values, is_text, is_time, unit};

/// Key of the unit in a field's metadata.
pub(super) const UNIT: &str = "unit";

/// The columns of a table and how they are read.
pub(super) struct ArrowTable {
    columns: Vec<Column>,
    types: Vec<arrow_schema::DataType>,
    /// How columns of text are read, where the layout says it.
    kinds: Vec<Option<Kind>>,
    nan_is_missing: bool,
    since: Since,
}

impl ArrowTable {
    pub(super) fn new(schema: &Schema, layout: &CsvLayout) -> Self {
        let fields = schema.fields();
        let columns: Vec<Column> = fields.iter().map(|field| column(field)).collect();
        let kinds = columns.iter().zip(fields).map(|(column, field)| {
            let channel = layout.layout_of_column(&column.name);
            let kind = channel.and_then(|channel| channel.kind);
            (kind.filter(|_| is_text(field.data_type()))).map(|kind| Kind::of(kind, channel))
        });
        let kinds: Vec<Option<Kind>> = kinds.collect();
        let with_unit = |(mut column, kind): (Column, &Option<Kind>)| {
            let unit = kind.as_ref().and_then(Kind::unit);
            column.unit = unit.map(Into::into).or(column.unit);
            column
        };
        Self {
            columns: columns.into_iter().zip(&kinds).map(with_unit).collect(),
            types: fields.iter().map(|f| f.data_type().clone()).collect(),
            kinds,
            nan_is_missing: layout.written_nan == WrittenNan::Missing,
            since: Since::First,
        }
    }

    /// The same with timestamps as seconds `since`.
    pub(super) fn since(self, since: Since) -> Self {
        Self { since, ..self }
    }

    pub(super) fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Refuses a picked column that holds no numbers.
    pub(super) fn check_numbers(&self, picks: &[usize]) -> Result<(), Problem> {
        for &column in picks {
            let data_type = &self.types[column];
            let is_stated = is_text(data_type) && self.kinds[column].is_some();
            if !is_number(data_type) && !is_stated {
                return Err(Problem::NotNumeric {
                    column: shown(&self.columns[column].name),
                    found: shown(data_type.to_string()),
                });
            }
        }
        Ok(())
    }

    /// Delivers the rows of `batches`, `total` as far as that is known; column `picks[k]` of the
    /// table is column `places[k]` of a batch and becomes their column `k`.
    pub(super) fn run(
        mut self,
        (picks, places): (&[usize], &[usize]),
        batches: impl Iterator<Item = Result<RecordBatch, Problem>>,
        total: u64,
        output: &Output,
    ) -> Result<(), Problem> {
        let mut done = 0;
        let mut rows = Rows::with_columns(picks.len());
        let mut sources: Vec<Values> = (picks.iter())
            .map(|&column| {
                let name = shown(&self.columns[column].name);
                Values::new(name, self.kinds[column].take(), self.since)
            })
            .collect();
        for batch in batches {
            let batch = batch?;
            for (k, &place) in places.iter().enumerate() {
                let values = batch.column(place);
                let from = rows.columns[k].len();
                sources[k].append(values, &mut rows.columns[k])?;
                check(
                    values,
                    &rows.columns[k][from..],
                    k == Rows::TIME,
                    self.nan_is_missing,
                )
                .map_err(|(i, allowed)| Problem::Cell {
                    row: Row {
                        row: done + i as u64 + 1,
                        line: None,
                    },
                    column: shown(&self.columns[picks[k]].name),
                    found: if values.is_null(i) {
                        "null".into()
                    } else {
                        rows.columns[k][from + i].to_string()
                    },
                    allowed,
                })?;
            }
            done += batch.num_rows() as u64;
            // A block may be longer than a batch.
            if rows.t().len() >= BLOCK_ROWS {
                let full = std::mem::replace(&mut rows, Rows::with_columns(picks.len()));
                if !output.deliver(full, done as f64 / total.max(done) as f64) {
                    return Ok(());
                }
            }
        }
        if !rows.t().is_empty() {
            output.deliver(rows, 1.0);
        }
        Ok(())
    }
}

/// Name and unit of a field: from its metadata, its name, or its type.
fn column(field: &Field) -> Column {
    let mut column = match field.metadata().get(UNIT) {
        Some(unit) => Column {
            name: field.name().clone(),
            unit: Some(unit.clone()),
        },
        None => Column::from_header(field.name()),
    };
    let data_type = field.data_type();
    if is_time(data_type) || column.unit.is_none() {
        column.unit = unit(data_type).map(Into::into).or(column.unit);
    }
    column
}

/// Finds a value that is no usable number: its index and what it may be.
fn check(
    values: &ArrayRef,
    numbers: &[f64],
    is_time: bool,
    nan_is_missing: bool,
) -> Result<(), (usize, &'static str)> {
    let unusable = |(i, v): (usize, &f64)| {
        if v.is_finite() || (!is_time && (values.is_null(i) || v.is_nan() && nan_is_missing)) {
            return None;
        }
        Some((
            i,
            if is_time {
                FINITE_TIME
            } else if v.is_nan() {
                NO_NAN
            } else {
                FINITE
            },
        ))
    };
    numbers
        .iter()
        .enumerate()
        .find_map(unusable)
        .map_or(Ok(()), Err)
}
