//! Holds a recording as a stream of Arrow record batches, which is read once (`Batches`): the first
//! batches can be looked at before, then all are read as rows of numbers (`ArrowStream`) or written
//! to a Parquet file.

use std::fmt;
use std::fs::File;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

use arrow_array::RecordBatch;
use arrow_schema::{ArrowError, Schema, SchemaRef};
use parquet::arrow::ArrowWriter;

use super::ArrowTable;
use crate::error::{Problem, RecordingError};
use crate::recording_layout::{Column, CsvLayout};
use crate::row_source::Output;
use crate::{BLOCK_ROWS, clipped};

type Stream = Box<dyn Iterator<Item = Result<RecordBatch, ArrowError>> + Send>;

/// Record batches that are read once, in order; those at the beginning may be looked at before. A
/// clone shares the stream.
#[derive(Clone)]
pub struct Batches {
    schema: SchemaRef,
    unread: Arc<Mutex<Option<Unread>>>,
}

struct Unread {
    /// Batches that were looked at.
    head: Vec<RecordBatch>,
    rest: Stream,
}

impl fmt::Debug for Batches {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Batches")
            .field("schema", &self.schema)
            .finish_non_exhaustive()
    }
}

fn damaged(error: impl fmt::Display) -> Problem {
    Problem::Damaged {
        format: "Arrow",
        found: clipped(error.to_string().as_bytes(), 160),
    }
}

impl Batches {
    /// Batches of one schema.
    pub fn new(
        schema: SchemaRef,
        batches: impl Iterator<Item = Result<RecordBatch, ArrowError>> + Send + 'static,
    ) -> Self {
        let unread = Unread {
            head: Vec::new(),
            rest: Box::new(batches),
        };
        Self {
            schema,
            unread: Arc::new(Mutex::new(Some(unread))),
        }
    }

    /// The first batches, `rows` rows or more where there are so many; they are kept in memory
    /// until they are read.
    pub(crate) fn head(&self, rows: usize) -> Result<Self, Problem> {
        let mut unread = self.unread.lock().unwrap_or_else(PoisonError::into_inner);
        let unread = unread.as_mut().ok_or_else(|| damaged(ONCE))?;
        let mut held: usize = unread.head.iter().map(RecordBatch::num_rows).sum();
        while held < rows {
            let Some(batch) = unread.rest.next() else {
                break;
            };
            let batch = batch.map_err(damaged)?;
            held += batch.num_rows();
            unread.head.push(batch);
        }
        let head = unread.head.clone().into_iter().map(Ok);
        Ok(Self::new(Arc::clone(&self.schema), head))
    }

    /// Writes them to a Parquet file in `path`, as they are.
    ///
    /// # Errors
    /// When they cannot be read, or the file cannot be written.
    pub fn write_parquet(&self, path: &Path) -> Result<(), RecordingError> {
        let write = || {
            let file = File::create(path).map_err(Problem::Unwritable)?;
            let mut writer =
                ArrowWriter::try_new(file, Arc::clone(&self.schema), None).map_err(damaged)?;
            for batch in self.take()? {
                writer.write(&batch.map_err(damaged)?).map_err(damaged)?;
            }
            writer.close().map_err(damaged)
        };
        let written = write().map_err(|problem| RecordingError {
            file: path.to_path_buf(),
            problem,
        });
        written.map(|_| ())
    }

    fn take(&self) -> Result<impl Iterator<Item = Result<RecordBatch, ArrowError>>, Problem> {
        let mut unread = self.unread.lock().unwrap_or_else(PoisonError::into_inner);
        let Unread { head, rest } = unread.take().ok_or_else(|| damaged(ONCE))?;
        Ok(head.into_iter().map(Ok).chain(rest))
    }
}

/// Why a stream is refused.
const ONCE: &str = "a stream is read once; give a new one";

/// Batches with the layout by which they are read.
pub(crate) struct ArrowStream {
    table: ArrowTable,
    batches: Batches,
}

impl ArrowStream {
    pub(crate) fn open(batches: &Batches, layout: &CsvLayout) -> Self {
        let schema: &Schema = &batches.schema;
        Self {
            table: ArrowTable::new(schema, layout),
            batches: batches.clone(),
        }
    }

    pub(crate) fn columns(&self) -> &[Column] {
        self.table.columns()
    }

    pub(crate) fn table(&self) -> &ArrowTable {
        &self.table
    }

    /// Delivers all rows; column `picks[k]` of the table becomes their column `k`.
    pub(crate) fn run(self, picks: &[usize], output: &Output) -> Result<(), Problem> {
        self.table.check_numbers(picks)?;
        let width = self.batches.schema.fields().len();
        let blocks = self.batches.take()?.flat_map(|batch| {
            let blocks: Vec<_> = match batch {
                Ok(batch) => (0..batch.num_rows())
                    .step_by(BLOCK_ROWS)
                    .map(|from| Ok(batch.slice(from, BLOCK_ROWS.min(batch.num_rows() - from))))
                    .collect(),
                Err(error) => vec![Err(damaged(error))],
            };
            blocks
        });
        let whole = blocks.map(|batch| {
            batch.and_then(|batch| {
                if batch.num_columns() == width {
                    Ok(batch)
                } else {
                    Err(damaged(
                        "a batch has another number of columns than the schema",
                    ))
                }
            })
        });
        self.table.run((picks, picks), whole, 0, output)
    }
}
