//! `candump -L` logs, read and written.

use std::fs::File;
use std::io::{self, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use socketcan::CanAnyFrame;
use socketcan::dump::{CanDumpRecord, ParseError, Reader};

use loadtwin_files::content::Content;

use super::CanError;
use super::bus::{Bus, BusError, Received};

/// A log, frame by frame; sending is refused.
///
/// A line that is no frame is counted and passed over. A log of several
/// interfaces is read whole unless one is chosen. The R and T that
/// `candump -x` adds may stand at the ends of lines.
pub struct LogBus<R> {
    reader: Reader<BufReader<R>>,
    interface: Option<String>,
    now_us: u64,
    lines: u64,
    malformed: u64,
    first_malformed: Option<u64>,
}

impl LogBus<File> {
    /// Opens a log; with `interface`, only the frames of that one are read.
    ///
    /// # Errors
    /// When the file cannot be opened.
    pub fn open(path: &Path, interface: Option<&str>) -> Result<Self, CanError> {
        let file = File::open(path).map_err(|source| CanError::File {
            path: path.into(),
            source,
        })?;
        Ok(Self::new(file, interface))
    }
}

impl<R: Read> LogBus<R> {
    /// Reads a log from `source`.
    pub fn new(source: R, interface: Option<&str>) -> Self {
        Self {
            reader: Reader::from_reader(source),
            interface: interface.map(str::to_owned),
            now_us: 0,
            lines: 0,
            malformed: 0,
            first_malformed: None,
        }
    }

    /// Lines read so far, where none of them is a frame.
    pub fn lines_without_frames(&self) -> Option<u64> {
        (self.malformed > 0 && self.malformed == self.lines).then_some(self.malformed)
    }

    /// Lines that are no frame, and the number of the first.
    pub fn malformed(&self) -> (u64, Option<u64>) {
        (self.malformed, self.first_malformed)
    }
}

impl<R: Read> Bus for LogBus<R> {
    fn receive(&mut self, _timeout: Duration) -> Result<Option<Received>, BusError> {
        loop {
            let record = self.reader.next_record();
            self.lines += u64::from(!matches!(record, Ok(None)));
            match record {
                Ok(None) => return Err(BusError::Ended),
                Ok(Some(record)) => {
                    if self
                        .interface
                        .as_ref()
                        .is_none_or(|name| *name == record.device)
                    {
                        self.now_us = record.t_us;
                        return Ok(Some(Received {
                            t_us: record.t_us,
                            frame: record.frame,
                        }));
                    }
                }
                // Bytes that are no text come as an error of this kind.
                Err(ParseError::Io(error)) if error.kind() != io::ErrorKind::InvalidData => {
                    return Err(error.into());
                }
                Err(_) => {
                    self.malformed += 1;
                    self.first_malformed.get_or_insert(self.lines);
                }
            }
        }
    }

    fn send(&mut self, _frame: &CanAnyFrame) -> Result<(), BusError> {
        Err(io::Error::new(io::ErrorKind::Unsupported, "a log takes no frames").into())
    }

    fn restart(&mut self) -> Result<(), BusError> {
        Ok(())
    }

    fn now(&self) -> Duration {
        Duration::from_micros(self.now_us)
    }

    fn wait(&mut self, _time: Duration) {}
}

/// Lines that are written at once [bytes].
const LINES: usize = 8 << 10;

/// Longest time for which a frame stays in memory.
const LONGEST_US: u64 = 1_000_000;

/// Content type of the log of a bus.
pub const LOG: Content = Content {
    noun: "log of a bus",
    suffixes: &["log", "candump", "txt"],
    is_same: |_| Ok(false),
};

/// Writes frames as `candump -L` does, into a new file that grows by whole lines:
/// where the program is killed, what came before is there.
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
        let record = CanDumpRecord {
            t_us: received.t_us,
            device: self.interface.clone(),
            frame: received.frame,
            direction: None,
        };
        if self.lines.is_empty() {
            self.first_us = received.t_us;
        }
        let is_due = received.t_us.saturating_sub(self.first_us) >= LONGEST_US;
        let written = writeln!(self.lines, "{record}").and_then(|()| {
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
    pub fn finish(mut self) -> Result<(), CanError> {
        let written = self.write_lines().and_then(|()| self.file.sync_all());
        written.map_err(|source| self.failed(source))
    }

    fn failed(&self, source: io::Error) -> CanError {
        CanError::File {
            path: self.path.clone(),
            source,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::standard;

    #[test]
    fn a_log_of_another_program_has_no_frames() {
        let view = " (1436509052.249713)  vcan0  501   [2]  00 11\n".repeat(3);
        let mut bus = LogBus::new(view.as_bytes(), None);
        assert!(matches!(bus.receive(Duration::ZERO), Err(BusError::Ended)));
        assert_eq!(bus.lines_without_frames(), Some(3));
        let mut empty = LogBus::new(&b""[..], None);
        assert!(matches!(
            empty.receive(Duration::ZERO),
            Err(BusError::Ended)
        ));
        assert_eq!(empty.lines_without_frames(), None);
        let mixed = "(1.000000) vcan0 501#00\n".to_owned() + &view;
        let mut mixed = LogBus::new(mixed.as_bytes(), None);
        while mixed.receive(Duration::ZERO).is_ok() {}
        assert_eq!(mixed.lines_without_frames(), None);
    }

    #[test]
    fn lines_of_every_kind_are_read_and_the_rest_is_counted() {
        let log = "(1436509052.249713) vcan0 501#0011223344556677\n\
                   (1436509052.449847) vcan0 501#0011223344556677 R\n\
                   (1436509052.449847) can1 502#0011223344556677 T\n\
                   not a frame\n\
                   (1436509053.000001) vcan0 50F##0AABBCCDD\n\
                   (1436509053.000002) vcan0 1F334455#1122\n\
                   (1436509053.000003) vcan0 123#R\n\
                   (1436509053.000004) vcan0 20000004#000C000000000000\n\
                   (1436509053.000005) vcan0 501#001122334\n\
                   \n";
        let mut bus = LogBus::new(log.as_bytes(), Some("vcan0"));
        let mut frames = Vec::new();
        let end = loop {
            match bus.receive(Duration::ZERO) {
                Ok(frame) => frames.push(frame.expect("a log never times out")),
                Err(end) => break end,
            }
        };
        assert!(matches!(end, BusError::Ended));
        assert_eq!(frames.len(), 6);
        assert_eq!(frames[0].t_us, 1_436_509_052_249_713);
        assert_eq!(
            standard(&frames[1].frame),
            Some((0x501, &[0, 0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77][..]))
        );
        assert_eq!(
            standard(&frames[2].frame),
            Some((0x50F, &[0xAA, 0xBB, 0xCC, 0xDD][..]))
        );
        assert!(frames[3..].iter().all(|f| standard(&f.frame).is_none()));
        assert_eq!(bus.malformed(), (3, Some(4)));
    }

    #[test]
    fn what_is_written_is_read_again() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("log");
        let lines =
            "(0.000001) can0 501#00112233\n(1.000000) can0 50F##4AABB\n(1.500000) can0 18FF0001#\n";
        let mut bus = LogBus::new(lines.as_bytes(), None);
        let mut writer = LogWriter::create(&path, "can0").expect("created");
        while let Ok(Some(received)) = bus.receive(Duration::ZERO) {
            writer.write(&received).expect("written");
        }
        writer.finish().expect("written");
        assert_eq!(std::fs::read_to_string(&path).expect("read"), lines);
    }
}
