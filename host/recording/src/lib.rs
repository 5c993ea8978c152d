//! Reads and writes recordings of a machine in CSV, Parquet, MDF4 or Arrow: one row a sample, the
//! time `t` and then channels, a unit for each. Here: the public names of the crate, and the number
//! of rows in a block.
//!
//! | format | recognised by | unit of a column | read | written |
//! |---|---|---|---|---|
//! | CSV | none of the others | header `name [unit]`, or [`CsvLayout`] | streamed | streamed |
//! | Parquet | `PAR1` | field metadata `unit`, or a name `name [unit]` | streamed | streamed |
//! | MDF4 | `MDF     ` | unit of the channel | streamed | from memory, bounded |
//!
//! A [`Reader`] hands out [`Block`]s in the units the caller wants, and refuses
//! time that runs backwards or has gaps. Memory does not grow with the length
//! of the recording. A [`Writer`] leaves a file behind only when it is whole.
#![forbid(unsafe_code)]

mod arrow;
mod channel_names;
mod clock_state;
mod column_selection;
mod csv;
mod error;
mod file_survey;
mod first_time;
mod foreign_formats;
mod mdf;
mod parquet;
mod reader;
mod recording_layout;
mod regular_stretch;
mod resample;
mod row_source;
mod sampling_grid;
mod table_writer;
mod unit;

pub use arrow::Batches;
pub use clock_state::Clock;
use error::clipped;
pub use error::{Problem, RecordingError, Row};
pub use file_survey::{Change, RATES_HZ, Survey, SurveyedColumn, survey};
pub use first_time::first_time;
pub use reader::{Block, Reader};
pub use recording_layout::{
    ChannelLayout, Column, ColumnType, CsvLayout, Role, Timing, Wanted, WrittenNan,
};
pub use row_source::{Input, columns};
pub use table_writer::{OutputColumn, SIMULATED, SUFFIXES, Writer, record_batch, schema};
pub use unit::{Conversion, Quantity, Unit, UnknownUnit};

/// Rows of a block, before the rows put into gaps.
pub const BLOCK_ROWS: usize = 8192;

/// Name of the time column.
const TIME: &str = "t";

/// Foreign text in a message, at most 40 characters on one line.
fn shown(text: impl AsRef<[u8]>) -> String {
    clipped(text.as_ref(), 40)
}
