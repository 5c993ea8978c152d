//! Finds where an output path leads: to standard output, a pipe or a device, or to the plain file
//! at the end of all links (`Destination`). Also identifies a file under different names
//! (`Identity`).

use std::ffi::OsString;
use std::fs::{File, Metadata};
use std::io;
use std::path::{Path, PathBuf};

use super::scratch;
use super::system::FileId;
pub(crate) use super::system::{stdin_file, stdout_file};

/// Links that are followed one after another, as the Linux kernel does.
const MOST_LINKS: usize = 40;

/// The file that a path refers to, whatever it is called.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Identity {
    /// A file that is there.
    There(FileId),
    /// One that is not: its folder, and its name.
    Absent(FileId, OsString),
}

impl Identity {
    /// The identity of a file that is there, at `path` where it has one.
    pub(crate) fn of(path: &Path, metadata: &Metadata) -> Self {
        Self::There(FileId::of(path, metadata))
    }
}

/// Where an output goes.
#[derive(Debug)]
pub(crate) enum Destination {
    /// Standard output, a pipe, a device: written to directly.
    Stream(File),
    /// A plain file, there or not.
    Plain(Box<Place>),
}

/// The place of a plain file, all links followed.
#[derive(Debug)]
pub(crate) struct Place {
    pub(crate) folder: PathBuf,
    pub(crate) name: OsString,
    /// Of the file that is there.
    pub(crate) existing: Option<Metadata>,
}

impl Place {
    /// Whether it is a scratch file, which need not outlive the system nor be
    /// kept apart from those of other runs.
    pub(crate) fn is_temporary(&self) -> bool {
        self.folder.components().any(|part| {
            let name = part.as_os_str().to_string_lossy();
            name.starts_with(scratch::PREFIX)
        })
    }

    pub(crate) fn path(&self) -> PathBuf {
        self.folder.join(&self.name)
    }

    /// # Errors
    /// When the folder is not there.
    pub(crate) fn identity(&self) -> io::Result<Identity> {
        if let Some(metadata) = &self.existing {
            return Ok(Identity::of(&self.path(), metadata));
        }
        let folder = self.folder.metadata()?;
        let folder = FileId::of(&self.folder, &folder);
        Ok(Identity::Absent(folder, self.name.clone()))
    }
}

/// Whether `path` is a way to write standard output: `-`, `/dev/stdout`, or the
/// file that standard output was redirected to.
pub(crate) fn is_stdout(path: &Path) -> bool {
    if path == Path::new("-") || path == Path::new("/dev/stdout") {
        return true;
    }
    let stdout = stdout_file().and_then(|file| file.metadata());
    matches!((path.metadata(), stdout), (Ok(a), Ok(b))
        if a.is_file() && b.is_file() && Identity::of(path, &a) == Identity::of(Path::new("-"), &b))
}

/// Whether `path` is no plain file: standard output, a pipe, a device.
pub fn is_stream(path: &Path) -> bool {
    let there = path.metadata();
    is_stdout(path) || there.is_ok_and(|there| !there.is_file() && !there.is_dir())
}

/// Finds where `path` leads, through links, also one whose target is not there.
///
/// # Errors
/// For a folder, a circle of links, a file or folder that cannot be reached.
pub(crate) fn destination(path: &Path) -> io::Result<Destination> {
    if is_stdout(path) {
        return Ok(Destination::Stream(stdout_file()?));
    }
    let mut path = path.to_path_buf();
    for _ in 0..MOST_LINKS {
        let descriptor = path.starts_with("/dev/fd") || path.starts_with("/proc/self/fd");
        match path.metadata() {
            Ok(found) if found.is_dir() => return Err(io::ErrorKind::IsADirectory.into()),
            Ok(found) if !found.is_file() || descriptor => {
                let file = File::options().write(true).open(&path)?;
                return Ok(Destination::Stream(file));
            }
            Ok(_) => {}
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => return Err(error),
        }
        let Ok(target) = path.read_link() else {
            return Ok(Destination::Plain(Box::new(plain(&path)?)));
        };
        path = path.parent().unwrap_or(Path::new("")).join(target);
    }
    Err(io::Error::other("too many links"))
}

fn plain(path: &Path) -> io::Result<Place> {
    let name = path.file_name().ok_or(io::ErrorKind::InvalidFilename)?;
    let folder = match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    };
    Ok(Place {
        folder: folder.to_path_buf(),
        name: name.to_owned(),
        existing: path.metadata().ok(),
    })
}
