//! Reads recordings in Parquet (`Parquet`): decodes the picked columns in batches, which
//! `ArrowTable` converts to rows in f64. Units stand in the metadata of the fields; null is a
//! missing sample.
mod page_size;

use std::fs::File;
use std::sync::Arc;

use arrow_schema::{DataType, Field, Fields, Schema};
use parquet::arrow::ProjectionMask;
use parquet::arrow::arrow_reader::{
    ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReaderBuilder,
};

use super::arrow::{ArrowTable, Since, is_number};
use super::error::Problem;
use super::recording_layout::{Column, CsvLayout};
use super::row_source::Output;
use super::{BLOCK_ROWS, clipped};
use page_size::Bounded;

pub(super) struct Parquet {
    file: File,
    metadata: ArrowReaderMetadata,
    table: ArrowTable,
}

fn damaged(error: impl std::fmt::Display) -> Problem {
    Problem::Damaged {
        format: "Parquet",
        found: clipped(error.to_string().as_bytes(), 160),
    }
}

impl Parquet {
    pub(super) fn open(file: File, layout: &CsvLayout, since: Since) -> Result<Self, Problem> {
        let metadata = ArrowReaderMetadata::load(&file, ArrowReaderOptions::default())
            .and_then(plain)
            .map_err(damaged)?;
        Ok(Self {
            table: ArrowTable::new(metadata.schema(), layout).since(since),
            file,
            metadata,
        })
    }

    pub(super) fn columns(&self) -> &[Column] {
        self.table.columns()
    }

    pub(super) fn table(&self) -> &ArrowTable {
        &self.table
    }

    /// Delivers all rows; column `picks[k]` of the file becomes their column `k`.
    pub(super) fn run(self, picks: &[usize], output: &Output) -> Result<(), Problem> {
        let Self {
            file,
            metadata,
            table,
        } = self;
        table.check_numbers(picks)?;
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
        let mut places = vec![0; picks.len()];
        for (place, &k) in in_file_order.iter().enumerate() {
            places[k] = place;
        }
        let batches = batches.map(|batch| batch.map_err(damaged));
        table.run((picks, &places), batches, total as u64, output)
    }
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
