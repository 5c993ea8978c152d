//! Error type of a run over an archive: refused input, files that cannot be read or written, a stop
//! by the caller. `ends_the_run` separates errors that every machine would have (full or broken
//! disk) from those of one machine; `message` writes an error with its causes on one line.

use std::error::Error;
use std::io;
use std::path::{Path, PathBuf};

use thiserror::Error;

/// Why an archive, or one of its machines, is not replayed.
#[derive(Debug, Error)]
pub enum ArchiveError {
    /// Archive, table of descriptions, results or an option are not what they should be.
    #[error("{place}: {reason}")]
    Refused {
        /// File, line, folder or option.
        place: String,
        /// What was found, and what is allowed.
        reason: String,
    },
    /// A folder or file cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io {
        /// The folder or file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// The caller stopped the run; days that are done stay.
    #[error("stopped; days that are done stay")]
    Stopped,
}

impl ArchiveError {
    #[expect(
        clippy::needless_pass_by_value,
        reason = "errors and texts of all kinds"
    )]
    pub(crate) fn refused(place: impl ToString, reason: impl ToString) -> Self {
        Self::Refused {
            place: place.to_string(),
            reason: reason.to_string(),
        }
    }

    /// For `map_err` of what is done with `path`.
    pub(crate) fn io(path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Io {
            path: path.to_path_buf(),
            source,
        }
    }

    /// An error of a writer of `path`, with the error of the system that is its cause.
    pub(crate) fn unwritable(path: &Path, error: &(dyn Error + 'static)) -> Self {
        let source = match system_error(error) {
            Some(code) => io::Error::from_raw_os_error(code),
            None => io::Error::other(error.to_string()),
        };
        Self::io(path)(source)
    }

    /// Whether every other machine would have it too: the disk is full, read-only or broken, or the
    /// run was stopped.
    pub(crate) fn ends_the_run(&self) -> bool {
        /// Input or output error (EIO), which has no kind.
        const BROKEN: i32 = 5;
        use io::ErrorKind::{QuotaExceeded, ReadOnlyFilesystem, StorageFull};
        match self {
            Self::Refused { .. } => false,
            Self::Io { source, .. } => {
                matches!(
                    source.kind(),
                    StorageFull | QuotaExceeded | ReadOnlyFilesystem
                ) || source.raw_os_error() == Some(BROKEN)
            }
            Self::Stopped => true,
        }
    }
}

/// The number of the system's error among the causes of an error.
fn system_error(error: &(dyn Error + 'static)) -> Option<i32> {
    let mut cause = Some(error);
    while let Some(error) = cause {
        let io = error.downcast_ref::<io::Error>();
        if let Some(code) = io.and_then(io::Error::raw_os_error) {
            return Some(code);
        }
        cause = match io.and_then(io::Error::get_ref) {
            Some(inner) => Some(inner),
            None => error.source(),
        };
    }
    None
}

/// An error and its causes, but for those that its text ends with already.
pub fn message(error: &dyn Error) -> String {
    let mut said = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let text = error.to_string();
        if !said.ends_with(&text) {
            said = format!("{said}: {text}");
        }
        cause = error.source();
    }
    said
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_full_disk_is_found_among_the_causes() {
        const FULL: i32 = 28;
        let inner = io::Error::from_raw_os_error(FULL);
        let outer = io::Error::other(parquet::errors::ParquetError::from(inner));
        let error = ArchiveError::unwritable(Path::new("days.parquet"), &outer);
        assert!(error.ends_the_run(), "{error}");
        assert!(error.to_string().starts_with("days.parquet: "), "{error}");
        let other = io::Error::other("no number");
        assert!(!ArchiveError::unwritable(Path::new("x"), &other).ends_the_run());
    }
}
