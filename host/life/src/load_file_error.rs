//! Error type for files whose loads cannot be counted: unreadable, missing column or unit, or a
//! shaft too fast for the sample rate.

use std::path::PathBuf;

use loadtwin_recording::RecordingError;
use thiserror::Error;

/// Why the loads of a file cannot be counted; one line.
#[derive(Debug, Error)]
pub enum LoadFileError {
    /// The file cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// It has no column with a fault beside it.
    #[error(
        "{}: no column NAME with NAME_std and NAME_fault, as estimates have; name a column to count with --load", .0.display()
    )]
    NoLoad(PathBuf),
    /// A column without a unit, or with an unknown one.
    #[error("{}: column {name:?} has no unit that is known; write it as `{name} [Nm]`", file.display())]
    Unit {
        /// The file.
        file: PathBuf,
        /// The column.
        name: String,
    },
    /// A column that is not there.
    #[error("{}: no column {name:?}; found: {found}", file.display())]
    Missing {
        /// The file.
        file: PathBuf,
        /// The column.
        name: String,
        /// The columns that are there.
        found: String,
    },
    /// A speed by which the advance from sample to sample is not known.
    #[error(
        "{}: shaft turns {turns:.2} times between two samples; allowed: less than 1; check --speed and --ratio", file.display()
    )]
    Fast {
        /// The file.
        file: PathBuf,
        /// Turns from sample to sample.
        turns: f64,
    },
}
