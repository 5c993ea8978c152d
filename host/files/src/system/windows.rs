//! Windows counterpart of `unix.rs`: identity of files by canonical path, check of write access,
//! standard streams as files. Owner and permissions are not changed.

use std::fs::{File, Metadata};
use std::io;
use std::os::windows::io::AsHandle;
use std::path::{Path, PathBuf};

/// The file that a path refers to: its whole path; none of a file that is open without one.
#[derive(Clone, Debug, PartialOrd, Ord)]
pub(crate) struct FileId(Option<PathBuf>);

impl FileId {
    /// Of the file at `path`.
    pub(crate) fn of(path: &Path, _metadata: &Metadata) -> Self {
        Self(path.canonicalize().ok())
    }
}

/// Files without a path are not known to be the same.
impl PartialEq for FileId {
    fn eq(&self, other: &Self) -> bool {
        self.0.is_some() && self.0 == other.0
    }
}

impl Eq for FileId {}

/// Owner and permissions of a file: a new one has those of its folder.
#[derive(Debug)]
pub(crate) struct Owner;

impl Owner {
    /// Gives `file` those of a file that it replaces.
    pub(crate) fn keep(_file: &File, _replaced: &Metadata) -> io::Result<()> {
        Ok(())
    }

    /// Takes away the permissions that are not in `mode`.
    pub(crate) fn limit(_file: &File, _mode: u32) -> io::Result<()> {
        Ok(())
    }

    /// A new file at `path`.
    pub(crate) fn new_like(_file: &File, path: &Path) -> io::Result<File> {
        File::options().write(true).create_new(true).open(path)
    }
}

/// Whether `path` may be written, or files be made in it.
pub(crate) fn check_writable(path: &Path, is_folder: bool) -> io::Result<()> {
    if is_folder {
        return path.metadata().map(drop);
    }
    File::options().write(true).open(path).map(drop)
}

pub(crate) fn stdout_file() -> io::Result<File> {
    Ok(io::stdout().as_handle().try_clone_to_owned()?.into())
}

pub(crate) fn stdin_file() -> io::Result<File> {
    Ok(io::stdin().as_handle().try_clone_to_owned()?.into())
}
