//! Recordings as Parquet: a unit in the metadata of each field, nulls where a
//! sample is missing.
use std::fs::File;

use arrow_array::cast::AsArray;
use arrow_array::types::{
    ArrowPrimitiveType, Float32Type, Float64Type, Int8Type, Int16Type, Int32Type, Int64Type,
    UInt8Type, UInt16Type, UInt32Type, UInt64Type,
};
use arrow_array::{Array, ArrayRef};
use arrow_schema::DataType;
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::ParquetRecordBatchReaderBuilder;

use super::error::{FINITE, FINITE_TIME, NO_NAN};
use super::error::{Problem, Row};
use super::layout::{Column, CsvLayout, WrittenNan};
use super::source::{Output, Rows};
use super::{BLOCK_ROWS, clipped, shown};

/// Key of the unit in a field's metadata.
pub(super) const UNIT: &str = "unit";

pub(super) struct Parquet {
    builder: ParquetRecordBatchReaderBuilder<File>,
    columns: Vec<Column>,
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
        let builder = ParquetRecordBatchReaderBuilder::try_new(file).map_err(damaged)?;
        let columns =
            builder
                .schema()
                .fields()
                .iter()
                .map(|field| match field.metadata().get(UNIT) {
                    Some(unit) => Column {
                        name: field.name().clone(),
                        unit: Some(unit.clone()),
                    },
                    None => Column::from_header(field.name()),
                });
        Ok(Self {
            columns: columns.collect(),
            builder,
            nan_is_missing: layout.written_nan == WrittenNan::Missing,
        })
    }

    pub(super) fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Delivers all rows; column `picks[k]` of the file becomes their column `k`.
    pub(super) fn run(self, picks: &[usize], output: &Output) -> Result<(), Problem> {
        let Self {
            builder,
            columns,
            nan_is_missing,
        } = self;
        for &column in picks {
            let data_type = builder.schema().field(column).data_type();
            if !is_number(data_type) {
                return Err(Problem::NotNumeric {
                    column: shown(&columns[column].name),
                    found: shown(data_type.to_string()),
                });
            }
        }
        let total = builder.metadata().file_metadata().num_rows();
        let mask = ProjectionMask::roots(builder.parquet_schema(), picks.iter().copied());
        let batches = builder
            .with_projection(mask)
            .with_batch_size(BLOCK_ROWS)
            .build()
            .map_err(damaged)?;
        // A batch has its columns in the order of the file.
        let mut in_file_order: Vec<_> = (0..picks.len()).collect();
        in_file_order.sort_by_key(|&k| picks[k]);

        let mut done = 0;
        let mut rows = Rows::with_columns(picks.len());
        for batch in batches {
            let batch = batch.map_err(damaged)?;
            for (&k, values) in in_file_order.iter().zip(batch.columns()) {
                let from = rows.columns[k].len();
                append(values, &mut rows.columns[k])?;
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

/// Appends the values as f64, NaN where there is none.
fn append(values: &ArrayRef, to: &mut Vec<f64>) -> Result<(), Problem> {
    match values.data_type() {
        DataType::Float64 => extend::<Float64Type>(values, to, |v| v),
        DataType::Float32 => extend::<Float32Type>(values, to, f64::from),
        DataType::Int8 => extend::<Int8Type>(values, to, f64::from),
        DataType::Int16 => extend::<Int16Type>(values, to, f64::from),
        DataType::Int32 => extend::<Int32Type>(values, to, f64::from),
        DataType::Int64 => extend::<Int64Type>(values, to, |v| v as f64),
        DataType::UInt8 => extend::<UInt8Type>(values, to, f64::from),
        DataType::UInt16 => extend::<UInt16Type>(values, to, f64::from),
        DataType::UInt32 => extend::<UInt32Type>(values, to, f64::from),
        DataType::UInt64 => extend::<UInt64Type>(values, to, |v| v as f64),
        other => return Err(damaged(format!("a column of numbers became {other}"))),
    }
    Ok(())
}

fn extend<T: ArrowPrimitiveType>(
    values: &ArrayRef,
    to: &mut Vec<f64>,
    as_f64: impl Fn(T::Native) -> f64,
) {
    let values = values.as_primitive::<T>();
    if values.null_count() == 0 {
        to.extend(values.values().iter().map(|&v| as_f64(v)));
    } else {
        to.extend(values.iter().map(|v| v.map_or(f64::NAN, &as_f64)));
    }
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

fn is_number(data_type: &DataType) -> bool {
    data_type.is_integer() || matches!(data_type, DataType::Float32 | DataType::Float64)
}
