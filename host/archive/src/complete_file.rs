//! Atomic writing of files (temporary file, sync, rename), removal of the temporary files that
//! killed processes left, and a file lock between processes.
//!
//! Each file has a name of its own until it is complete, as several processes may write into one
//! folder, also on different computers.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::Path;

use loadtwin_files::atomic_file::remove_leftover;
use tempfile::NamedTempFile;

use crate::ArchiveError;

/// End of the name of a file that is being written; its name begins with a point.
const PART: &str = ".part";

/// Characters of the complete file's name that the name before it has.
const NAME: usize = 50;

/// Permissions of a new file, from which the user's umask takes away.
#[cfg(unix)]
const NEW_FILE: u32 = 0o666;

/// A file that is being written beside its place.
pub(crate) fn begin(path: &Path) -> io::Result<NamedTempFile> {
    let folder = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(folder)?;
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let name: String = name.chars().take(NAME).collect();
    let prefix = format!(".{name}.");
    let mut builder = tempfile::Builder::new();
    builder.prefix(&prefix).suffix(PART);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(fs::Permissions::from_mode(NEW_FILE));
    }
    builder.tempfile_in(folder)
}

/// Brings a file onto the disk and gives it its name, in place of one that is there.
pub(crate) fn finish(file: NamedTempFile, path: &Path) -> io::Result<()> {
    file.as_file().sync_all()?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}

/// Writes a complete file.
///
/// # Errors
/// [`ArchiveError::Io`] when it cannot be written.
pub(crate) fn write(path: &Path, content: &[u8]) -> Result<(), ArchiveError> {
    let write = || {
        let mut file = begin(path)?;
        file.write_all(content)?;
        finish(file, path)
    };
    write().map_err(ArchiveError::io(path))
}

/// As [`write`], without waiting for the disk: a reader that holds its hash finds out
/// whether a power cut has damaged it.
///
/// # Errors
/// [`ArchiveError::Io`] when it cannot be written.
pub(crate) fn write_hashed(path: &Path, content: &[u8]) -> Result<(), ArchiveError> {
    let write = || {
        let mut file = begin(path)?;
        file.write_all(content)?;
        file.persist(path).map_err(|error| error.error)
    };
    write().map(drop).map_err(ArchiveError::io(path))
}

/// Removes the temporary files that killed processes left in a folder and in the folders inside it.
///
/// # Errors
/// [`ArchiveError::Io`] when a folder cannot be read.
pub(crate) fn remove_parts(folder: &Path) -> Result<(), ArchiveError> {
    let remove = || {
        let entries = match fs::read_dir(folder) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
            entries => entries?,
        };
        remove_leftover(folder)?;
        let mut folders = Vec::new();
        for entry in entries {
            let entry = entry?;
            let name = entry.file_name();
            let name = name.to_string_lossy();
            if entry.file_type()?.is_dir() {
                folders.push(entry.path());
            } else if name.starts_with('.') && name.ends_with(PART) {
                fs::remove_file(entry.path())?;
            }
        }
        Ok(folders)
    };
    let folders = remove().map_err(ArchiveError::io(folder))?;
    folders.iter().try_for_each(|folder| remove_parts(folder))
}

/// A lock between processes, until it is dropped; the kernel frees that of a killed one.
#[derive(Debug)]
pub(crate) struct Lock {
    _file: File,
}

impl Lock {
    /// Waits for the lock.
    ///
    /// # Errors
    /// [`ArchiveError::Io`] when its file cannot be made, or the file system has no locks.
    pub(crate) fn wait(path: &Path) -> Result<Self, ArchiveError> {
        let lock = || {
            fs::create_dir_all(path.parent().unwrap_or(Path::new(".")))?;
            let file = OpenOptions::new().append(true).create(true).open(path)?;
            file.lock()?;
            Ok(Self { _file: file })
        };
        lock().map_err(ArchiveError::io(path))
    }
}
