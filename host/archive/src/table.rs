//! Makes Arrow columns from iterators of texts, counts, numbers, lists, structs and fault counts,
//! for the tables of results. Writes a table as a compressed Parquet file that gets its name when
//! it is complete.

use std::path::Path;
use std::sync::Arc;

use arrow_array::{
    Array, ArrayRef, BooleanArray, Float32Array, Float64Array, Int64Array, ListArray, MapArray,
    RecordBatch, StringArray, StructArray,
};
use arrow_buffer::OffsetBuffer;
use arrow_schema::{ArrowError, Field, Fields};
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, ZstdLevel};
use parquet::errors::ParquetError;
use parquet::file::properties::WriterProperties;

use crate::day::Flags;
use crate::{ArchiveError, complete_file};

/// A table.
pub(crate) type Table = Result<RecordBatch, ArrowError>;

/// A column.
pub(crate) type Column = Result<ArrayRef, ArrowError>;

/// Writes a table to a complete file.
///
/// # Errors
/// [`ArchiveError::Io`] when it cannot be written.
pub(crate) fn write(path: &Path, table: &RecordBatch) -> Result<(), ArchiveError> {
    let mut file = complete_file::begin(path).map_err(ArchiveError::io(path))?;
    let mut written = || -> Result<(), ParquetError> {
        let properties = WriterProperties::builder()
            .set_created_by(concat!("loadtwin ", env!("CARGO_PKG_VERSION")).into())
            .set_compression(Compression::ZSTD(ZstdLevel::default()))
            .build();
        let mut writer = ArrowWriter::try_new(&mut file, table.schema(), Some(properties))?;
        writer.write(table)?;
        writer.close().map(drop)
    };
    written().map_err(|error| ArchiveError::unwritable(path, &error))?;
    complete_file::finish(file, path).map_err(ArchiveError::io(path))
}

pub(crate) fn texts<'a>(values: impl Iterator<Item = Option<&'a str>>) -> ArrayRef {
    Arc::new(values.collect::<StringArray>())
}

pub(crate) fn counts(values: impl Iterator<Item = u64>) -> ArrayRef {
    let values = values.map(|count| i64::try_from(count).unwrap_or(i64::MAX));
    Arc::new(values.collect::<Int64Array>())
}

pub(crate) fn numbers(values: impl Iterator<Item = Option<f64>>) -> ArrayRef {
    Arc::new(values.collect::<Float64Array>())
}

pub(crate) fn singles(values: impl Iterator<Item = Option<f32>>) -> ArrayRef {
    Arc::new(values.collect::<Float32Array>())
}

pub(crate) fn booleans(values: impl Iterator<Item = bool>) -> ArrayRef {
    Arc::new(values.map(Some).collect::<BooleanArray>())
}

/// A column of structs.
pub(crate) fn structs<const N: usize>(columns: [(&str, ArrayRef); N]) -> Column {
    let field =
        |(name, column): &(&str, ArrayRef)| Field::new(*name, column.data_type().clone(), true);
    let fields: Fields = columns.iter().map(field).collect();
    let columns = columns.into_iter().map(|(_, column)| column).collect();
    Ok(Arc::new(StructArray::try_new(fields, columns, None)?))
}

/// A column of lists, whose values `of` makes of those of all rows.
pub(crate) fn lists<'a, T: 'a>(
    rows: impl Iterator<Item = &'a [T]>,
    of: impl FnOnce(&[&'a T]) -> Column,
) -> Column {
    let rows: Vec<&[T]> = rows.collect();
    let values: Vec<&T> = rows.iter().copied().flatten().collect();
    let values = of(&values)?;
    let offsets = OffsetBuffer::from_lengths(rows.iter().map(|row| row.len()));
    let field = Arc::new(Field::new_list_field(values.data_type().clone(), true));
    Ok(Arc::new(ListArray::try_new(field, offsets, values, None)?))
}

/// A column of maps from a fault to how often it was flagged.
pub(crate) fn flags<'a>(rows: impl Iterator<Item = &'a Flags>) -> Column {
    let rows: Vec<&Flags> = rows.collect();
    let names: StringArray = (rows.iter())
        .flat_map(|flags| flags.keys())
        .map(Some)
        .collect();
    let found = counts(rows.iter().flat_map(|flags| flags.values().copied()));
    let fields: Fields = [
        Field::new("key", names.data_type().clone(), false),
        Field::new("value", found.data_type().clone(), true),
    ]
    .into_iter()
    .collect();
    let entries = StructArray::try_new(fields, vec![Arc::new(names), found], None)?;
    let field = Arc::new(Field::new("key_value", entries.data_type().clone(), false));
    let offsets = OffsetBuffer::from_lengths(rows.iter().map(|flags| flags.len()));
    Ok(Arc::new(MapArray::try_new(
        field, offsets, entries, None, false,
    )?))
}
