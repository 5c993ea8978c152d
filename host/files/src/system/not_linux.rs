//! Makes unnamed files on systems other than Linux, which cannot name them later: `link` fails, so
//! that the caller copies the file.

use std::fs::File;
use std::io;
use std::path::Path;

/// A file without a name in `folder`.
pub(crate) fn unnamed(folder: &Path) -> io::Result<File> {
    tempfile::tempfile_in(folder)
}

/// Gives a file without a name the name `path`, which must be free.
pub(crate) fn link(_file: &File, path: &Path) -> io::Result<()> {
    let kind = if path.exists() {
        io::ErrorKind::AlreadyExists
    } else {
        io::ErrorKind::Unsupported
    };
    Err(kind.into())
}
