//! Files of a recorder: their names, the next sequence, and the limit on their size on the disk,
//! kept by deletion of the oldest.
//!
//! `SEQUENCE-FIRST_TIME-RECORDER.parquet`: the sequence never repeats, the recorder is a random number
//! of the first start. A file of another name is never deleted.

use std::collections::VecDeque;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use chrono::DateTime;

/// Name of the file with `sequence` whose first row is at `t` (s).
pub fn file_name(sequence: u64, t: f64, recorder: &str) -> String {
    let time = DateTime::from_timestamp_micros((t * 1e6) as i64).unwrap_or_default();
    format!(
        "{sequence:010}-{}-{recorder}.parquet",
        time.format("%Y%m%dT%H%M%S%.6fZ")
    )
}

/// Day of `t` (s), UTC.
pub fn day_of(t: f64) -> String {
    let time = DateTime::from_timestamp_micros((t * 1e6) as i64).unwrap_or_default();
    time.format("%Y-%m-%d").to_string()
}

/// Sequence of a file of `recorder` by its name.
fn sequence_of(name: &str, recorder: &str) -> Option<u64> {
    let mut parts = name.strip_suffix(".parquet")?.splitn(3, '-');
    let (sequence, _, by) = (parts.next()?, parts.next()?, parts.next()?);
    (by == recorder && sequence.len() == 10).then(|| sequence.parse().ok())?
}

/// Files that this recorder has written, the oldest first.
#[derive(Debug, Default)]
pub struct OwnFiles {
    files: VecDeque<(u64, PathBuf, u64)>,
    bytes: u64,
}

impl OwnFiles {
    /// Finds them in the folders of days in `folders`.
    ///
    /// # Errors
    /// When a folder cannot be read.
    pub fn find(folders: &[PathBuf], recorder: &str) -> io::Result<Self> {
        let mut files = Vec::new();
        for day in folders.iter().filter(|folder| folder.is_dir()) {
            for day in fs::read_dir(day)? {
                let day = day?;
                if !day.file_type()?.is_dir() {
                    continue;
                }
                for file in fs::read_dir(day.path())? {
                    let file = file?;
                    let found = sequence_of(&file.file_name().to_string_lossy(), recorder);
                    if let Some(sequence) = found {
                        files.push((sequence, file.path(), file.metadata()?.len()));
                    }
                }
            }
        }
        files.sort();
        Ok(Self {
            bytes: files.iter().map(|file| file.2).sum(),
            files: files.into(),
        })
    }

    /// Sequence after the last file.
    pub fn next_sequence(&self) -> u64 {
        self.files.back().map_or(0, |file| file.0 + 1)
    }

    /// Takes a new one.
    pub fn push(&mut self, sequence: u64, path: &Path) {
        let bytes = path.metadata().map_or(0, |found| found.len());
        self.bytes += bytes;
        self.files.push_back((sequence, path.to_owned(), bytes));
    }

    /// Deletes the oldest until at most `most` bytes or one file are left; files and bytes deleted.
    ///
    /// # Errors
    /// When one cannot be deleted.
    pub fn bound(&mut self, most: u64) -> io::Result<(u64, u64)> {
        let (mut deleted, mut freed) = (0, 0);
        while self.bytes > most && self.files.len() > 1 {
            let Some((_, path, bytes)) = self.files.pop_front() else {
                break;
            };
            self.bytes -= bytes;
            match fs::remove_file(&path) {
                Ok(()) => (deleted, freed) = (deleted + 1, freed + bytes),
                // Somebody moved it away.
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                Err(error) => return Err(error),
            }
            // Only an empty folder goes.
            let _ = path.parent().map(fs::remove_dir);
        }
        Ok((deleted, freed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_oldest_own_files_go_and_no_others() {
        let dir = tempfile::tempdir().unwrap();
        let day = dir.path().join(format!("day={}", day_of(1e9)));
        fs::create_dir(&day).unwrap();
        let names: Vec<_> = (0..4)
            .map(|k| file_name(k, 1e9 + k as f64, "0123abcd"))
            .collect();
        assert_eq!(
            names[1],
            "0000000001-20010909T014641.000000Z-0123abcd.parquet"
        );
        let others = [file_name(0, 1e9, "ffffffff"), "recording.parquet".into()];
        for name in names.iter().chain(&others) {
            fs::write(day.join(name), [0; 100]).unwrap();
        }
        let mut own = OwnFiles::find(&[dir.path().to_owned()], "0123abcd").unwrap();
        assert_eq!(own.next_sequence(), 4);
        assert_eq!(own.bound(250).unwrap(), (2, 200));
        let left = |name: &String| day.join(name).exists();
        assert_eq!(
            names.iter().map(left).collect::<Vec<_>>(),
            [false, false, true, true]
        );
        assert!(others.iter().all(left));
    }
}
