//! Recordings of a machine: one row a sample, the time `t` and then channels,
//! a unit for each.
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
mod clock;
mod csv;
mod error;
mod foreign;
mod grid;
mod layout;
mod mdf;
mod parquet;
mod reader;
mod resample;
mod selection;
mod source;
mod survey;
mod unit;
mod writer;

pub use arrow::Batches;
pub use clock::Clock;
use error::clipped;
pub use error::{Problem, RecordingError, Row};
pub use layout::{ChannelLayout, Column, ColumnType, CsvLayout, Role, Timing, Wanted, WrittenNan};
pub use reader::{Block, Reader};
pub use source::{Input, columns};
pub use survey::{Change, RATES_HZ, Survey, SurveyedColumn, survey};
pub use unit::{Conversion, Quantity, Unit, UnknownUnit};
pub use writer::{OutputColumn, SIMULATED, SUFFIXES, Writer, record_batch, schema};

/// Rows of a block, before the rows put into gaps.
pub const BLOCK_ROWS: usize = 8192;

/// Name of the time column.
const TIME: &str = "t";

/// Foreign text in a message, at most 40 characters on one line.
fn shown(text: impl AsRef<[u8]>) -> String {
    clipped(text.as_ref(), 40)
}
