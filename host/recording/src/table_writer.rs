//! Writes tables of time and columns to CSV, Parquet or MDF4, block by block (`Writer`), for
//! simulated recordings and for estimates; NaN is a missing sample. Also makes the Arrow schema and
//! record batches of such a table.
use std::collections::HashMap;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use arrow_array::{ArrayRef, Float32Array, Float64Array, RecordBatch};
use arrow_schema::{ArrowError, DataType, Field, Schema};
use falcon_mdf::{Mf4Writer, SignalValues};
use parquet::arrow::ArrowWriter;
use parquet::basic::{Compression, Encoding};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::WriterProperties;

use super::TIME;
use super::arrow::UNIT;
use super::error::{Problem, RecordingError};
use super::unit::Unit;
use loadtwin_files::atomic_file::{AtomicFile, Complete, publish};
use loadtwin_files::file_kind::FileKind;
use loadtwin_files::outputs::is_stream;

/// Rows that a Parquet file holds together; they are in memory until written.
const ROW_GROUP: usize = 1 << 16;

/// Most values of an MDF4 file: its writer puts it together in memory.
const MDF_VALUES: usize = 32 << 20;

/// Suffixes of the tables that can be written.
pub const SUFFIXES: &[&str] = &["csv", "parquet", "mf4"];

/// What is written as the recording of a simulated machine.
pub const SIMULATED: FileKind = FileKind {
    noun: "simulated recording",
    suffixes: SUFFIXES,
    // Of CSV the comments, of the others the metadata.
    is_same: |file| match file.start() {
        [b'P', b'A', b'R', b'1', ..] => file.contains(&["loadtwin ", "scenario", "seed"]),
        [b'M', b'D', b'F', b' ', ..] => file.contains(&["scenario: ", "seed: "]),
        _ => Ok(file.start().starts_with(b"# machine: ")
            && file.contains(&["\n# scenario: ", "\n# seed: "])?),
    },
};

/// A column to be written, besides the time.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutputColumn {
    /// Name, without the unit.
    pub name: String,
    /// Unit that the values are in.
    pub unit: Unit,
    /// Whether the values come from f32 and are stored as such, at half the
    /// size: the shortest decimal that gives the same f32 back.
    pub single: bool,
}

/// Writes a table of time and columns by blocks: CSV, Parquet or MDF4 by the
/// extension of its name, CSV to standard output (`-`). Nothing is there under that name before
/// [`Writer::finish`].
///
/// NaN is written as a missing sample: an empty cell, a null, an invalid sample.
///
/// ```
/// use loadtwin_recording::{OutputColumn, Writer};
/// # let dir = tempfile::tempdir()?;
/// # let path = dir.path().join("estimates.csv");
/// let torque = OutputColumn { name: "torque_main".into(), unit: "Nm".parse()?, single: true };
/// let mut writer = Writer::create(&path, &[torque], &[("machine", "bench")])?;
/// writer.write(&[0.0, 0.002], &[&[0.1, f64::NAN]])?;
/// writer.finish()?;
/// let text = "# machine: bench\nt [s],torque_main [Nm]\n0,0.1\n0.002,\n";
/// assert_eq!(std::fs::read_to_string(&path)?, text);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Writer {
    path: PathBuf,
    columns: Vec<OutputColumn>,
    format: Format,
}

enum Format {
    Csv(AtomicFile, Vec<u8>),
    // Boxed: ten times the size of the others.
    Parquet(Box<ArrowWriter<AtomicFile>>),
    Mdf {
        file: AtomicFile,
        t: Vec<f64>,
        values: Vec<Vec<f64>>,
        comment: String,
    },
}

impl Writer {
    /// Begins a file. `metadata`: what the file says about itself, such as the
    /// machine; comment lines in CSV, key-value metadata in Parquet, the
    /// comment of the first channel in MDF4.
    ///
    /// # Errors
    /// [`RecordingError`] when the extension is none of csv, parquet, mf4, or
    /// when there can be no file of that name.
    pub fn create(
        path: &Path,
        columns: &[OutputColumn],
        metadata: &[(&str, &str)],
    ) -> Result<Self, RecordingError> {
        let format = Format::create(path, columns, metadata);
        Ok(Self {
            format: format.map_err(|problem| at(path, problem))?,
            path: path.to_path_buf(),
            columns: columns.to_vec(),
        })
    }

    /// Appends rows: time in s and each column in its unit, all as long as `t`.
    ///
    /// # Errors
    /// [`RecordingError`] when they cannot be written.
    ///
    /// # Panics
    /// When the columns are not those of [`Writer::create`] or not as long as `t`.
    pub fn write(&mut self, t: &[f64], columns: &[&[f64]]) -> Result<(), RecordingError> {
        assert_eq!(columns.len(), self.columns.len(), "number of columns");
        for values in columns {
            assert_eq!(values.len(), t.len(), "length of a column");
        }
        self.format
            .write(&self.columns, t, columns)
            .map_err(|problem| at(&self.path, problem))
    }

    /// Completes the file and gives it its name.
    ///
    /// # Errors
    /// [`RecordingError`] when it cannot be written.
    pub fn finish(self) -> Result<(), RecordingError> {
        publish([self.complete()?])
            .map_err(|error| at(&error.path, Problem::Unwritable(error.source)))
    }

    /// Completes the file, which has no name before it is published.
    ///
    /// # Errors
    /// [`RecordingError`] when it cannot be written.
    pub fn complete(self) -> Result<Complete, RecordingError> {
        let Self {
            path,
            columns,
            format,
        } = self;
        format
            .complete(&columns)
            .map_err(|problem| at(&path, problem))
    }
}

fn at(path: &Path, problem: Problem) -> RecordingError {
    RecordingError {
        file: path.to_path_buf(),
        problem,
    }
}

impl Format {
    fn create(
        path: &Path,
        columns: &[OutputColumn],
        metadata: &[(&str, &str)],
    ) -> Result<Self, Problem> {
        let extension = path.extension().unwrap_or_default().to_string_lossy();
        let create = || AtomicFile::create(path).map_err(Problem::Unwritable);
        match extension.to_ascii_lowercase().as_str() {
            "" if !is_stream(path) => Err(Problem::Extension {
                found: String::new(),
            }),
            "csv" | "" => {
                let mut text = Vec::new();
                write_header(&mut text, columns, metadata).map_err(Problem::Unwritable)?;
                Ok(Self::Csv(create()?, text))
            }
            "parquet" => {
                let writer = parquet_writer(create()?, columns, metadata);
                Ok(Self::Parquet(Box::new(writer.map_err(unwritable)?)))
            }
            "mf4" => Ok(Self::Mdf {
                file: create()?,
                t: Vec::new(),
                values: vec![Vec::new(); columns.len()],
                comment: comment(metadata, "; "),
            }),
            _ => Err(Problem::Extension {
                found: super::shown(&*extension),
            }),
        }
    }

    fn write(
        &mut self,
        described: &[OutputColumn],
        t: &[f64],
        columns: &[&[f64]],
    ) -> Result<(), Problem> {
        match self {
            Self::Csv(file, text) => {
                write_rows(text, described, t, columns)
                    .and_then(|()| file.write_all(text))
                    .map_err(Problem::Unwritable)?;
                text.clear();
            }
            Self::Parquet(writer) => {
                let batch = record_batch(described, t, columns)
                    .map_err(|e| unwritable(ParquetError::from(e)))?;
                writer.write(&batch).map_err(unwritable)?;
            }
            Self::Mdf { t: all, values, .. } => {
                let found = (all.len() + t.len()) * (columns.len() + 1);
                if found > MDF_VALUES {
                    return Err(Problem::TooLong {
                        found,
                        allowed: MDF_VALUES,
                    });
                }
                all.extend_from_slice(t);
                for (all, new) in values.iter_mut().zip(columns) {
                    all.extend_from_slice(new);
                }
            }
        }
        Ok(())
    }

    fn complete(self, described: &[OutputColumn]) -> Result<Complete, Problem> {
        let file = match self {
            Self::Csv(mut file, text) => {
                // The header, where no row came after it.
                file.write_all(&text).map_err(Problem::Unwritable)?;
                file
            }
            Self::Parquet(writer) => writer.into_inner().map_err(unwritable)?,
            Self::Mdf {
                mut file,
                t,
                values,
                comment,
            } => {
                write_mdf(&mut file, described, &t, values, &comment)
                    .map_err(|e| Problem::Unwritable(io::Error::other(e)))?;
                file
            }
        };
        file.complete().map_err(Problem::Unwritable)
    }
}

fn unwritable(error: ParquetError) -> Problem {
    Problem::Unwritable(io::Error::other(error))
}

/// `key: value` of each, on one line each.
fn comment(metadata: &[(&str, &str)], between: &str) -> String {
    let lines: Vec<_> = metadata
        .iter()
        .map(|(key, value)| format!("{key}: {value}").replace(['\n', '\r'], " "))
        .collect();
    lines.join(between)
}

fn write_header(
    text: &mut Vec<u8>,
    columns: &[OutputColumn],
    metadata: &[(&str, &str)],
) -> io::Result<()> {
    for &line in metadata {
        writeln!(text, "# {}", comment(&[line], ""))?;
    }
    let mut writer = csv::Writer::from_writer(text);
    writer.write_field(format!("{TIME} [{}]", Unit::SECOND))?;
    for column in columns {
        writer.write_field(format!("{} [{}]", column.name, column.unit))?;
    }
    writer.write_record(None::<&[u8]>)?;
    writer.flush()
}

fn write_rows(
    text: &mut Vec<u8>,
    described: &[OutputColumn],
    t: &[f64],
    columns: &[&[f64]],
) -> io::Result<()> {
    for i in 0..t.len() {
        write_number(text, t[i])?;
        for (column, values) in described.iter().zip(columns) {
            text.push(b',');
            let value = values[i];
            if value.is_nan() {
                // Nothing is a missing sample.
            } else if column.single {
                write_number(text, value as f32)?;
            } else {
                write_number(text, value)?;
            }
        }
        text.push(b'\n');
    }
    Ok(())
}

/// The shortest decimal that gives the same number back.
fn write_number<T>(text: &mut Vec<u8>, value: T) -> io::Result<()>
where
    T: Copy + Into<f64> + std::fmt::Display + std::fmt::LowerExp,
{
    let size = value.into().abs();
    if size == 0.0 || (1e-4..1e15).contains(&size) {
        write!(text, "{value}")
    } else {
        write!(text, "{value:e}")
    }
}

/// Rows of a table of time and columns as Arrow; NaN is null.
///
/// # Errors
/// When columns and time differ in length.
pub fn record_batch(
    described: &[OutputColumn],
    t: &[f64],
    columns: &[&[f64]],
) -> Result<RecordBatch, ArrowError> {
    let mut arrays: Vec<ArrayRef> = vec![Arc::new(Float64Array::from(t.to_vec()))];
    let columns = described.iter().zip(columns);
    arrays.extend(columns.map(|(column, values)| array(column, values)));
    RecordBatch::try_new(Arc::new(schema(described)), arrays)
}

/// Names, types and units of a table of time and columns in Arrow.
pub fn schema(columns: &[OutputColumn]) -> Schema {
    let field = |name: &str, unit: Unit, data_type, nullable| {
        Field::new(name, data_type, nullable)
            .with_metadata(HashMap::from([(UNIT.to_string(), unit.to_string())]))
    };
    let mut fields = vec![field(TIME, Unit::SECOND, DataType::Float64, false)];
    fields.extend(columns.iter().map(|c| {
        let data_type = if c.single {
            DataType::Float32
        } else {
            DataType::Float64
        };
        field(&c.name, c.unit, data_type, true)
    }));
    Schema::new(fields)
}

fn parquet_writer(
    file: AtomicFile,
    columns: &[OutputColumn],
    metadata: &[(&str, &str)],
) -> Result<ArrowWriter<AtomicFile>, ParquetError> {
    let said = metadata
        .iter()
        .map(|(key, value)| KeyValue::new((*key).to_string(), (*value).to_string()))
        .collect();
    let properties = WriterProperties::builder()
        .set_created_by(concat!("loadtwin ", env!("CARGO_PKG_VERSION")).into())
        .set_key_value_metadata(Some(said))
        .set_max_row_group_row_count(Some(ROW_GROUP))
        // Measured values hardly repeat, but their high bytes do.
        .set_dictionary_enabled(false)
        .set_encoding(Encoding::BYTE_STREAM_SPLIT)
        .set_compression(Compression::LZ4_RAW)
        .build();
    ArrowWriter::try_new(file, Arc::new(schema(columns)), Some(properties))
}

fn array(column: &OutputColumn, values: &[f64]) -> ArrayRef {
    let present = |v: &f64| (!v.is_nan()).then_some(*v);
    if column.single {
        let values = values.iter().map(|v| present(v).map(|v| v as f32));
        Arc::new(values.collect::<Float32Array>())
    } else {
        Arc::new(values.iter().map(present).collect::<Float64Array>())
    }
}

fn write_mdf(
    file: &mut AtomicFile,
    described: &[OutputColumn],
    t: &[f64],
    columns: Vec<Vec<f64>>,
    comment: &str,
) -> Result<(), falcon_mdf::Mf4Error> {
    // The same rows give the same file: no time stamp.
    let mut writer = Mf4Writer::with_start_time_ns(0);
    let group = writer.add_group(t)?;
    for (column, values) in described.iter().zip(columns) {
        let valid: Vec<bool> = values.iter().map(|v| !v.is_nan()).collect();
        let valid = valid.contains(&false).then_some(valid.as_slice());
        let values = if column.single {
            SignalValues::F32(values.iter().map(|&v| v as f32).collect())
        } else {
            SignalValues::F64(values)
        };
        let unit = column.unit.symbol();
        group.add_channel_typed_with(&column.name, unit, values, valid, None)?;
    }
    if let Some(first) = group.channels_mut().first_mut() {
        first.set_comment(comment);
    }
    writer.write(file)
}
