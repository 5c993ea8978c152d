//! Errors of the reduction of finite-element strains to strain maps: `ReduceError`.

use std::path::{Path, PathBuf};

use thiserror::Error;

use loadtwin_machine::MachineError;

/// Why no maps can be made; one line that names the place.
#[derive(Debug, Error)]
pub enum ReduceError {
    /// A file cannot be read.
    #[error("{}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A line of a file cannot be used.
    #[error("{}:{line}: {message}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// What was found and what is allowed.
        message: String,
    },
    /// The files do not fit each other or the machine.
    #[error("{}: {message}", path.display())]
    Misfit {
        /// The file.
        path: PathBuf,
        /// What was found and what is needed.
        message: String,
    },
    /// The description cannot be used.
    #[error(transparent)]
    Machine(#[from] MachineError),
}

impl ReduceError {
    pub(crate) fn read(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        |source| Self::Read {
            path: path.to_owned(),
            source,
        }
    }

    pub(crate) fn line(path: &Path, line: u64, message: impl Into<String>) -> Self {
        Self::Line {
            path: path.to_owned(),
            line,
            message: message.into(),
        }
    }

    pub(crate) fn misfit(path: &Path, message: impl Into<String>) -> Self {
        Self::Misfit {
            path: path.to_owned(),
            message: message.into(),
        }
    }
}
