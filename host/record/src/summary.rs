//! Reads and writes `summary.json`, what a recorder keeps across its restarts (`Summary`): its
//! random name, the next sequence of a file, the clock of the samples, and counts.
//!
//! It is written before the file that it counts gets its name. After a kill in between, the file is not
//! there, and the counts before it hold.

use std::io::Write;
use std::path::{Path, PathBuf};

use loadtwin_files::atomic_file::AtomicFile;
use loadtwin_files::bounded;
use serde::{Deserialize, Serialize};

use super::RecordError;
use super::counts::Counts;
use super::sample_clock::SampleClock;

/// Largest summary (bytes).
const LARGEST: u64 = 1 << 20;

/// Counts and clock at a point in time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Progress {
    /// Since the first start.
    pub counts: Counts,
    /// Of the last raw sample.
    pub clock: Option<SampleClock>,
}

/// The file that gets its name next.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Before {
    /// Relative to the archive.
    file: PathBuf,
    /// What holds without it.
    progress: Progress,
}

/// What a recorder knows of itself.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Summary {
    format: u32,
    /// Name of the machine.
    pub machine: String,
    /// By which its files are recognised: 8 hexadecimal digits in their names.
    pub recorder: String,
    /// Sequence of the next file.
    pub sequence: u64,
    /// With all files.
    pub progress: Progress,
    before: Option<Before>,
    #[serde(skip)]
    path: PathBuf,
}

impl Summary {
    /// Reads the summary in `path`, or begins one.
    ///
    /// # Errors
    /// When it cannot be read, or is none.
    pub fn open(path: &Path, archive: &Path, machine: &str) -> Result<Self, RecordError> {
        let text = match bounded::read_text(path, LARGEST) {
            Ok(text) => text,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                return Ok(Self {
                    format: 1,
                    machine: machine.to_owned(),
                    recorder: format!("{:08x}", rand::random::<u32>()),
                    sequence: 0,
                    progress: Progress::default(),
                    before: None,
                    path: path.to_owned(),
                });
            }
            Err(error) => return Err(RecordError::file(path, error)),
        };
        let refused = |why: String| RecordError::Summary {
            path: path.to_owned(),
            why,
        };
        let mut summary: Self =
            serde_json::from_str(&text).map_err(|error| refused(error.to_string()))?;
        if summary.format != 1 || summary.machine != machine {
            return Err(refused(format!(
                "found format {} of machine {}; allowed: format 1 of {machine}",
                summary.format, summary.machine
            )));
        }
        if let Some(before) = summary.before.take()
            && !archive.join(&before.file).exists()
        {
            summary.progress = before.progress;
        }
        path.clone_into(&mut summary.path);
        Ok(summary)
    }

    /// Takes `file`, which gets its name next, and its part of the progress.
    pub fn count(&mut self, file: Option<PathBuf>, counts: Counts, clock: Option<SampleClock>) {
        self.before = file.map(|file| Before {
            file,
            progress: self.progress,
        });
        self.progress.counts += counts;
        self.progress.clock = clock.or(self.progress.clock);
    }

    /// Takes back the last file, which could not be written, and counts otherwise.
    pub fn recount(&mut self, counts: Counts, clock: Option<SampleClock>) {
        if let Some(before) = self.before.take() {
            self.progress = before.progress;
        }
        self.count(None, counts, clock);
    }

    /// Writes it.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn save(&self) -> Result<(), RecordError> {
        let save = || {
            let mut file = AtomicFile::create(&self.path)?;
            serde_json::to_writer_pretty(&mut file, self)?;
            file.write_all(b"\n")?;
            file.finish()
        };
        save().map_err(|error| RecordError::file(&self.path, error))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_never_got_its_name_is_not_counted() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("summary.json");
        let mut summary = Summary::open(&path, dir.path(), "m").unwrap();
        let counts = |samples_written| Counts {
            samples_written,
            ..Counts::default()
        };
        summary.count(Some("a.parquet".into()), counts(5), None);
        summary.save().unwrap();
        std::fs::write(dir.path().join("a.parquet"), "").unwrap();
        let mut summary = Summary::open(&path, dir.path(), "m").unwrap();
        assert_eq!(summary.progress.counts, counts(5));
        summary.count(Some("b.parquet".into()), counts(7), None);
        summary.save().unwrap();
        let summary = Summary::open(&path, dir.path(), "m").unwrap();
        assert_eq!(summary.progress.counts, counts(5));
        assert!(Summary::open(&path, dir.path(), "other").is_err());
    }
}
