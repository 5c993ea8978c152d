//! Records a machine on a bus: raw samples and estimates to Parquet files of an archive, statistics
//! of loads and health to an MQTT broker.
//!
//! Files are complete or absent, and [`summary`] counts what came, what is in files and what is missing.
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::unreachable,
        clippy::todo,
        clippy::unimplemented
    )
)]

pub mod broker;
pub mod bus_rows;
pub mod counts;
pub mod load_statistics;
pub mod message_store;
pub mod own_files;
pub mod part_writer;
pub mod publisher;
pub mod recorder;
pub mod sample_clock;
pub mod summary;
pub mod telemetry;

use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

/// Why nothing is recorded.
#[derive(Debug, Error)]
pub enum RecordError {
    /// A file or folder that cannot be read or written.
    #[error("{path}: {source}")]
    File {
        /// Which.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A file that is no summary of this machine.
    #[error("{path}: {why}")]
    Summary {
        /// Which.
        path: PathBuf,
        /// What is wrong.
        why: String,
    },
    /// A name that cannot be a folder and a topic.
    #[error(
        "--name: found `{0}`, allowed: letters, digits, `-`, `_`, `.`; it begins with a letter or digit"
    )]
    Name(String),
    /// Another recorder.
    #[error("{0}: another recorder writes there; allowed: one for each machine")]
    Locked(PathBuf),
    /// A column twice.
    #[error("a sensor has the name `{0}` of the column of ticks; allowed: any other name")]
    Column(&'static str),
    /// The file of a part.
    #[error(transparent)]
    Recording(#[from] loadtwin_recording::RecordingError),
    /// The bus.
    #[error(transparent)]
    Can(#[from] loadtwin_can::CanError),
}

impl RecordError {
    fn file(path: &Path, source: io::Error) -> Self {
        Self::File {
            path: path.to_owned(),
            source,
        }
    }
}
