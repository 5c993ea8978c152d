//! Writes frames to a log file as `candump -L` does (`LogWriter`). The file is new and grows by
//! whole lines, so that it can be read where the program is killed.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use loadtwin_files::file_kind::FileKind;

use crate::CanError;
use crate::bus::Received;

/// Text that is written at once (bytes).
const LINES: usize = 8 << 10;

/// Longest time for which a frame stays in memory (us).
const LONGEST_US: u64 = 1_000_000;

/// Kind of the log of a bus.
pub const LOG: FileKind = FileKind {
    noun: "log of a bus",
    suffixes: &["log", "candump", "txt"],
    is_same: |_| Ok(false),
};

/// Writes frames as `candump -L` does, into a new file that grows by whole lines. Of a program that
/// is killed at most the last second or 8 KiB are missing.
pub struct LogWriter {
    file: File,
    lines: Vec<u8>,
    first_us: u64,
    path: PathBuf,
    interface: String,
}

impl LogWriter {
    /// Creates the log of `interface`.
    ///
    /// # Errors
    /// When the file cannot be created, or is there: a log cannot be recorded again.
    pub fn create(path: &Path, interface: &str) -> Result<Self, CanError> {
        let file = File::create_new(path).map_err(|source| CanError::File {
            path: path.into(),
            source,
        })?;
        Ok(Self {
            file,
            lines: Vec::with_capacity(LINES),
            first_us: 0,
            path: path.into(),
            interface: interface.to_owned(),
        })
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&mut self, received: &Received) -> Result<(), CanError> {
        let (seconds, us) = (received.t_us / 1_000_000, received.t_us % 1_000_000);
        let (interface, frame) = (&self.interface, received.frame);
        if self.lines.is_empty() {
            self.first_us = received.t_us;
        }
        let is_due = received.t_us.saturating_sub(self.first_us) >= LONGEST_US;
        let written =
            writeln!(self.lines, "({seconds}.{us:06}) {interface} {frame}").and_then(|()| {
                if is_due || self.lines.len() >= LINES {
                    self.write_lines()
                } else {
                    Ok(())
                }
            });
        written.map_err(|source| self.failed(source))
    }

    fn write_lines(&mut self) -> io::Result<()> {
        self.file.write_all(&self.lines)?;
        self.lines.clear();
        Ok(())
    }

    /// Writes what is still in memory.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn flush(&mut self) -> Result<(), CanError> {
        let written = self.write_lines().and_then(|()| self.file.sync_all());
        written.map_err(|source| self.failed(source))
    }

    /// As [`LogWriter::flush`], at the end.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn finish(mut self) -> Result<(), CanError> {
        self.flush()
    }

    fn failed(&self, source: io::Error) -> CanError {
        CanError::File {
            path: self.path.clone(),
            source,
        }
    }
}
