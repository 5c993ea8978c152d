//! Lists the machines, days and recordings of an archive (`recordings/machine=M/day=D/*.parquet`)
//! with size and time of change, and gives the paths of its results. Refuses a folder for the
//! results that holds other files or lies among the recordings.

use std::collections::BTreeMap;
use std::fs::{self, DirEntry};
use std::io;
use std::path::{Path, PathBuf, absolute};
use std::time::UNIX_EPOCH;

use chrono::NaiveDate;

use crate::{ArchiveError, complete_file};

/// Folder of the recordings in the archive: `machine=NAME/day=YYYY-MM-DD/*.parquet`.
const RECORDINGS: &str = "recordings";

/// File by which a folder of results is recognised.
const MARK: &str = "results.json";

/// What the file says.
const MARKED: &str = "{\"loadtwin\": \"results of an archive\", \"format\": 1}\n";

/// A file of an archive with what shows that it was changed.
#[derive(Clone, Debug)]
pub(crate) struct Recording {
    pub(crate) path: PathBuf,
    /// Name of the file.
    pub(crate) name: String,
    /// Bytes.
    pub(crate) size: u64,
    /// Nanoseconds since 1970.
    pub(crate) modified_ns: i128,
}

/// An archive of recordings: the folder with `recordings/` and `descriptions.csv`.
#[derive(Clone, Debug)]
pub(crate) struct Archive {
    pub(crate) folder: PathBuf,
}

/// A path as text, as the tasks of machines and the tables have it.
pub(crate) fn text(path: &Path) -> Result<String, ArchiveError> {
    let absolute = absolute(path).map_err(ArchiveError::io(path))?;
    let text = absolute.into_os_string().into_string();
    text.map_err(|_| ArchiveError::refused(path.display(), "allowed: a name in UTF-8"))
}

impl Archive {
    /// Finds the archive in `folder`.
    ///
    /// # Errors
    /// [`ArchiveError::Refused`] when it is none.
    pub(crate) fn open(folder: &Path) -> Result<Self, ArchiveError> {
        let refused = |reason: &str| Err(ArchiveError::refused(folder.display(), reason));
        if !folder.is_dir() {
            return refused("no such folder");
        }
        let archive = Self {
            folder: text(folder)?.into(),
        };
        if !archive.recordings().is_dir() {
            return refused("no archive: it has no folder recordings/machine=NAME/day=YYYY-MM-DD");
        }
        Ok(archive)
    }

    pub(crate) fn recordings(&self) -> PathBuf {
        self.folder.join(RECORDINGS)
    }

    /// Names of the machines.
    ///
    /// # Errors
    /// [`ArchiveError`] when there is none, or the folder cannot be read.
    pub(crate) fn machines(&self) -> Result<Vec<String>, ArchiveError> {
        let folder = self.recordings();
        let found = partitions(&folder, "machine").map_err(ArchiveError::io(&folder))?;
        if found.is_empty() {
            let reason = "empty archive: no folder machine=NAME";
            return Err(ArchiveError::refused(folder.display(), reason));
        }
        Ok(found.into_keys().collect())
    }

    /// Recordings of a machine by day, in the order of their names; days without recordings are left
    /// out. That a day is a date is not checked here.
    ///
    /// # Errors
    /// [`ArchiveError::Io`] when a folder cannot be read.
    pub(crate) fn days(
        &self,
        machine: &str,
    ) -> Result<BTreeMap<String, Vec<Recording>>, ArchiveError> {
        let folder = self.recordings().join(format!("machine={machine}"));
        let mut found = BTreeMap::new();
        for (day, folder) in partitions(&folder, "day").map_err(ArchiveError::io(&folder))? {
            let recordings = recordings(&folder).map_err(ArchiveError::io(&folder))?;
            if !recordings.is_empty() {
                found.insert(day, recordings);
            }
        }
        Ok(found)
    }
}

/// Folders `key=NAME` by their names.
fn partitions(folder: &Path, key: &str) -> io::Result<BTreeMap<String, PathBuf>> {
    let mut found = BTreeMap::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let value = (name.strip_prefix(key)).and_then(|name| name.strip_prefix('='));
        if let Some(value) = value.filter(|value| !value.is_empty())
            && path.is_dir()
        {
            found.insert(value.to_owned(), path.clone());
        }
    }
    Ok(found)
}

fn recordings(folder: &Path) -> io::Result<Vec<Recording>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        if name.ends_with(".parquet") && !name.starts_with(['.', '_']) {
            found.push(recording(&entry, name)?);
        }
    }
    found.sort_by(|a, b| a.name.cmp(&b.name));
    Ok(found)
}

fn recording(entry: &DirEntry, name: String) -> io::Result<Recording> {
    let path = entry.path();
    // A link that leads nowhere is a recording that cannot be read.
    let there = path.metadata().or_else(|_| path.symlink_metadata())?;
    let modified = there.modified()?;
    let modified_ns = match modified.duration_since(UNIX_EPOCH) {
        Ok(after) => after.as_nanos() as i128,
        Err(before) => -(before.duration().as_nanos() as i128),
    };
    Ok(Recording {
        path,
        name,
        size: there.len(),
        modified_ns,
    })
}

/// Folder of the results of an archive.
#[derive(Clone, Debug)]
pub(crate) struct Results {
    pub(crate) folder: PathBuf,
}

impl Results {
    /// Makes the folder, unless it holds something else.
    ///
    /// # Errors
    /// [`ArchiveError`] when it does, is among the recordings, or cannot be written.
    pub(crate) fn begin(folder: &Path, archive: &Archive) -> Result<Self, ArchiveError> {
        let refused = |reason: String| Err(ArchiveError::refused(folder.display(), reason));
        let results = Self {
            folder: text(folder)?.into(),
        };
        if results.folder.starts_with(archive.recordings()) {
            return refused("results inside the recordings; allowed: another folder".into());
        }
        let mark = results.folder.join(MARK);
        if mark.is_file() {
            return Ok(results);
        }
        let holds_something = || -> io::Result<bool> {
            Ok(results.folder.exists() && fs::read_dir(&results.folder)?.next().is_some())
        };
        if holds_something().map_err(ArchiveError::io(folder))? {
            return refused(format!(
                "holds files of others; allowed: a new or empty folder, or one with earlier results ({MARK})"
            ));
        }
        complete_file::write(&mark, MARKED.as_bytes())?;
        Ok(results)
    }

    /// Folder with the estimates of a machine on a day.
    pub(crate) fn estimates(&self, machine: &str, day: &str) -> PathBuf {
        self.all_estimates(machine).join(format!("day={day}"))
    }

    /// Folder with the estimates of a machine, by day.
    pub(crate) fn all_estimates(&self, machine: &str) -> PathBuf {
        self.folder
            .join("estimates")
            .join(format!("machine={machine}"))
    }

    /// Folder with the table of the days of a machine.
    pub(crate) fn days(&self, machine: &str) -> PathBuf {
        self.folder.join("days").join(format!("machine={machine}"))
    }
}

/// Whether a text is a date as 2026-11-28.
pub(crate) fn is_date(text: &str) -> bool {
    let date = NaiveDate::parse_from_str(text, "%Y-%m-%d");
    date.is_ok_and(|date| date.to_string() == text)
}
