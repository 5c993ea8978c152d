//! Recordings as Parquet: a unit in the metadata of each field, nulls where a
//! sample is missing.
mod page_size;
mod values;

use std::fs::File;
use std::sync::Arc;

use arrow_array::{Array, ArrayRef};
use arrow_schema::{DataType, Field, Fields, Schema};
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::{
    ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReaderBuilder,
};

use super::csv::Kind;
use super::error::{FINITE, FINITE_TIME, NO_NAN};
use super::error::{Problem, Row};
use super::layout::{Column, CsvLayout, WrittenNan};
use super::source::{Output, Rows};
use super::{BLOCK_ROWS, clipped, shown};
use page_size::Bounded;
use values::{Values, is_number, is_text, is_time, unit};

/// Key of the unit in a field's metadata.
pub(super) const UNIT: &str = "unit";

pub(super) struct Parquet {
    file: File,
    metadata: ArrowReaderMetadata,
    columns: Vec<Column>,
    /// How columns of text are read, where the layout says it.
    kinds: Vec<Option<Kind>>,
    nan_is_missing: bool,
}

fn damaged(error: impl std::fmt::Display) -> Problem {
    Problem::Damaged {
        format: "Parquet",
        found: clipped(error.to_string().as_bytes(), 160),
    }
}

impl Parquet {
    pub(super) fn open(file: File, layout: &CsvLayout) -> Result<Self, Problem> {
        let metadata = ArrowReaderMetadata::load(&file, ArrowReaderOptions::default())
            .and_then(plain)
            .map_err(damaged)?;
        let fields = metadata.schema().fields();
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
        Ok(Self {
            columns: columns.into_iter().zip(&kinds).map(with_unit).collect(),
            kinds,
            file,
            metadata,
            nan_is_missing: layout.written_nan == WrittenNan::Missing,
        })
    }

    pub(super) fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Delivers all rows; column `picks[k]` of the file becomes their column `k`.
    pub(super) fn run(self, picks: &[usize], output: &Output) -> Result<(), Problem> {
        let Self {
            file,
            metadata,
            columns,
            mut kinds,
            nan_is_missing,
        } = self;
        for &column in picks {
            let data_type = metadata.schema().field(column).data_type();
            let is_stated = is_text(data_type) && kinds[column].is_some();
            if !is_number(data_type) && !is_stated {
                return Err(Problem::NotNumeric {
                    column: shown(&columns[column].name),
                    found: shown(data_type.to_string()),
                });
            }
        }
        let total = metadata.metadata().file_metadata().num_rows();
        let mask = ProjectionMask::roots(metadata.parquet_schema(), picks.iter().copied());
        let bounded = Bounded::new(file, picks.len());
        let batches = ParquetRecordBatchReaderBuilder::new_with_metadata(bounded, metadata)
            .with_projection(mask)
            .with_batch_size(BLOCK_ROWS)
            .build()
            .map_err(damaged)?;
        // A batch has its columns in the order of the file.
        let mut in_file_order: Vec<_> = (0..picks.len()).collect();
        in_file_order.sort_by_key(|&k| picks[k]);

        let mut done = 0;
        let mut rows = Rows::with_columns(picks.len());
        let mut sources: Vec<Values> = (picks.iter())
            .map(|&column| Values::new(shown(&columns[column].name), kinds[column].take()))
            .collect();
        for batch in batches {
            let batch = batch.map_err(damaged)?;
            for (&k, values) in in_file_order.iter().zip(batch.columns()) {
                let from = rows.columns[k].len();
                sources[k].append(values, &mut rows.columns[k])?;
                check(
                    values,
                    &rows.columns[k][from..],
                    k == Rows::TIME,
                    nan_is_missing,
                )
                .map_err(|(i, allowed)| Problem::Cell {
                    row: Row {
                        row: done + i as u64 + 1,
                        line: None,
                    },
                    column: shown(&columns[picks[k]].name),
                    found: if values.is_null(i) {
                        "null".into()
                    } else {
                        rows.columns[k][from + i].to_string()
                    },
                    allowed,
                })?;
            }
            done += batch.num_rows() as u64;
            // Batches end with the row groups; a block may be longer than one.
            if rows.t().len() >= BLOCK_ROWS {
                let full = std::mem::replace(&mut rows, Rows::with_columns(picks.len()));
                if !output.deliver(full, done as f64 / total.max(1) as f64) {
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

/// The same with plain columns in place of dictionaries of numbers, which the decoder cannot make.
fn plain(metadata: ArrowReaderMetadata) -> parquet::errors::Result<ArrowReaderMetadata> {
    let is_dictionary = |data_type: &DataType| {
        matches!(data_type, DataType::Dictionary(..)) && is_number(data_type)
    };
    let fields = metadata.schema().fields();
    if !fields.iter().any(|field| is_dictionary(field.data_type())) {
        return Ok(metadata);
    }
    let plain = |field: &Arc<Field>| match field.data_type() {
        DataType::Dictionary(_, values) if is_number(values) => Arc::new(
            field
                .as_ref()
                .clone()
                .with_data_type(values.as_ref().clone()),
        ),
        _ => Arc::clone(field),
    };
    let fields: Fields = fields.iter().map(plain).collect();
    let schema = Schema::new_with_metadata(fields, metadata.schema().metadata().clone());
    let options = ArrowReaderOptions::default().with_schema(Arc::new(schema));
    ArrowReaderMetadata::try_new(Arc::clone(metadata.metadata()), options)
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
