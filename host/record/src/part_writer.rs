//! Writes parts of a recording to Parquet files on a thread beside the one that receives frames,
//! one file a part, and counts each part in the summary as written or not written. Deletes the
//! oldest files beyond a limit in bytes.

use std::fs;
use std::path::PathBuf;
use std::sync::mpsc::Receiver;

use loadtwin_recording::{OutputColumn, Writer};

use super::RecordError;
use super::counts::Counts;
use super::own_files::{OwnFiles, day_of, file_name};
use super::sample_clock::SampleClock;
use super::summary::Summary;

/// What a file holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Raw samples.
    Recordings,
    /// Estimates that the machine sent.
    Estimates,
}

impl Kind {
    /// Folder in the archive.
    pub fn folder(self) -> &'static str {
        match self {
            Self::Recordings => "recordings",
            Self::Estimates => "estimates",
        }
    }
}

/// Rows of one file, and what was counted since the part before; perhaps counts alone.
#[derive(Debug)]
pub struct Part {
    /// Which.
    pub kind: Kind,
    /// Times (s).
    pub t: Vec<f64>,
    /// As described.
    pub columns: Vec<Vec<f64>>,
    /// What is counted where the part is written.
    pub written: Counts,
    /// What is counted where it is not written.
    pub not_written: Counts,
    /// Clock after it.
    pub clock: Option<SampleClock>,
}

/// Where parts go.
pub struct PartWriter {
    /// The archive.
    pub archive: PathBuf,
    /// `machine=NAME`.
    pub machine_folder: String,
    /// Name in the description.
    pub machine_name: String,
    /// Columns of raw samples.
    pub samples: Vec<OutputColumn>,
    /// Columns of estimates.
    pub estimates: Vec<OutputColumn>,
    /// Most bytes on the disk.
    pub most_bytes: u64,
    /// Identity and counts.
    pub summary: Summary,
    /// Files so far.
    pub own: OwnFiles,
}

impl PartWriter {
    /// Writes what comes until the other end is dropped; `warn` reports what fails.
    pub fn run(mut self, parts: &Receiver<Part>, warn: &(dyn Fn(&str) + Sync)) -> Summary {
        for part in parts {
            if let Err(error) = self.write(&part) {
                warn(&format!("{error}: {} rows not written", part.t.len()));
                self.summary.recount(part.not_written, part.clock);
                // The next part tries again.
                let _ = self.summary.save();
            }
            match self.own.bound(self.most_bytes) {
                Ok((0, _)) => {}
                Ok((files, bytes)) => {
                    warn(&format!(
                        "--keep-gb: {files} of the oldest files deleted, {bytes} bytes"
                    ));
                    self.summary.progress.counts.files_deleted += files;
                    self.summary.progress.counts.bytes_deleted += bytes;
                }
                Err(error) => warn(&format!("--keep-gb: {error}")),
            }
        }
        self.summary
    }

    fn write(&mut self, part: &Part) -> Result<(), RecordError> {
        let Some(&first) = part.t.first() else {
            self.summary.count(None, part.written, part.clock);
            return self.summary.save();
        };
        let folder = PathBuf::from(part.kind.folder())
            .join(&self.machine_folder)
            .join(format!("day={}", day_of(first)));
        let sequence = self.summary.sequence;
        let name = folder.join(file_name(sequence, first, &self.summary.recorder));
        let path = self.archive.join(&name);
        let folder = self.archive.join(folder);
        fs::create_dir_all(&folder).map_err(|error| RecordError::file(&folder, error))?;
        let described = match part.kind {
            Kind::Recordings => &self.samples,
            Kind::Estimates => &self.estimates,
        };
        let sequence_text = sequence.to_string();
        let metadata = [
            ("machine", self.machine_name.as_str()),
            ("recorder", &self.summary.recorder),
            ("sequence", &sequence_text),
        ];
        let mut writer = Writer::create(&path, described, &metadata)?;
        let columns: Vec<&[f64]> = part.columns.iter().map(Vec::as_slice).collect();
        writer.write(&part.t, &columns)?;
        let complete = writer.complete()?;
        self.summary.sequence += 1;
        self.summary.count(Some(name), part.written, part.clock);
        self.summary.save()?;
        loadtwin_files::atomic_file::publish([complete])
            .map_err(|error| RecordError::file(&error.path, error.source))?;
        self.own.push(sequence, &path);
        Ok(())
    }
}
