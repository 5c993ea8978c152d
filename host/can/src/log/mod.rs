//! Reads logs of CAN buses as a `Bus` that only receives (`LogBus`), in candump, ASC, BLF or TRC
//! format, which is recognised by the beginning of the log. Logs are written as `candump -L` does
//! (`LogWriter`).
//!
//! | format | known by |
//! |---|---|
//! | `candump`, as a log and as printed | a line that is a frame |
//! | ASC (Vector) | a line `base hex` or `base dec` |
//! | BLF (Vector) | `LOGG` |
//! | TRC (PEAK), 1.0 to 2.1 | a first line that begins with `;` |
//!
//! BLF is read here and not by the crate `ablf` 0.2, which has no FD frames.

mod asc;
mod blf;
mod candump;
mod candump_writer;
mod line_parsing;
mod trc;

use std::fs::File;
use std::io::{self, BufRead, BufReader, Chain, Cursor, Read};
use std::path::Path;
use std::time::Duration;

use loadtwin_files::file_kind;

use super::CanError;
use super::bus::{Bus, BusError, Received};
use super::bus_frame::BusFrame;
use asc::Asc;
use blf::Blf;
use candump::Candump;
pub use candump_writer::{LOG, LogWriter};
use line_parsing::{Line, Parsed};
use trc::Trc;

/// Bytes by which a format is known.
const HEAD: usize = 16 << 10;

/// What editors put before text in UTF-8.
const BYTE_ORDER_MARK: &[u8] = "\u{feff}".as_bytes();

/// Lines by which a format is known.
const HEAD_LINES: usize = 50;

/// Longest line (bytes): an FD frame of ASC has 400.
const LONGEST_LINE: u64 = 64 << 10;

type Source<R> = BufReader<Chain<Cursor<Vec<u8>>, R>>;

/// How frames are read.
enum Format<R> {
    Candump(Candump, Source<R>),
    Asc(Asc, Source<R>),
    Trc(Trc, Source<R>),
    Blf(Blf<Source<R>>),
}

/// A log, frame by frame; sending is refused.
///
/// A malformed line is counted and passed over, as is a damaged container of a BLF log. A log of
/// several interfaces is read whole unless one is chosen.
pub struct LogBus<R> {
    format: Format<R>,
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
    /// When the file cannot be opened, or is no log.
    pub fn open(path: &Path, interface: Option<&str>) -> Result<Self, CanError> {
        let failed = |source| CanError::File {
            path: path.into(),
            source,
        };
        let file = File::open(path).map_err(failed)?;
        let (bus, found) = Self::start(file, interface).map_err(failed)?;
        match found {
            None => Ok(bus),
            Some(found) => Err(CanError::NoLog {
                path: path.into(),
                found,
            }),
        }
    }
}

impl<R: Read> LogBus<R> {
    /// Reads a log from `source`; what is no log has no frames.
    ///
    /// # Errors
    /// When its first bytes cannot be read.
    pub fn new(source: R, interface: Option<&str>) -> io::Result<Self> {
        Ok(Self::start(source, interface)?.0)
    }

    /// The log, and what it is where it is none.
    fn start(mut source: R, interface: Option<&str>) -> io::Result<(Self, Option<&'static str>)> {
        let mut head = Vec::new();
        source.by_ref().take(HEAD as u64).read_to_end(&mut head)?;
        if head.starts_with(BYTE_ORDER_MARK) {
            head.drain(..BYTE_ORDER_MARK.len());
        }
        let (format, found) = Format::of(head, source);
        let bus = Self {
            format,
            interface: interface.map(str::to_owned),
            now_us: 0,
            lines: 0,
            malformed: 0,
            first_malformed: None,
        };
        Ok((bus, found))
    }

    /// The next frame; none at the end.
    fn next(&mut self) -> io::Result<Option<Line>> {
        loop {
            let parsed = match &mut self.format {
                Format::Blf(blf) => return blf.next(),
                Format::Candump(candump, source) => line(source)?.map(|line| candump.parse(&line)),
                Format::Asc(asc, source) => line(source)?.map(|line| asc.parse(&line)),
                Format::Trc(trc, source) => line(source)?.map(|line| trc.parse(&line)),
            };
            self.lines += 1;
            match parsed {
                None => return Ok(None),
                Some(Parsed::Frame(line)) => return Ok(Some(line)),
                Some(Parsed::Other) => {}
                Some(Parsed::Malformed) => {
                    self.malformed += 1;
                    self.first_malformed.get_or_insert(self.lines);
                }
            }
        }
    }
}

impl<R: Read> Format<R> {
    /// The format of a log that begins with `head`, and what it is where it is none.
    fn of(head: Vec<u8>, source: R) -> (Self, Option<&'static str>) {
        let text = String::from_utf8_lossy(&head).into_owned();
        let whole = if head.len() < HEAD {
            text.as_str()
        } else {
            text.rsplit_once('\n').map_or("", |s| s.0)
        };
        let lines: Vec<&str> = whole
            .lines()
            .filter(|line| !line.trim().is_empty())
            .take(HEAD_LINES)
            .collect();
        let is_blf = head.starts_with(b"LOGG");
        let name = file_kind::named(&head);
        let is_empty = head.trim_ascii().is_empty();
        let source = BufReader::new(Cursor::new(head).chain(source));
        if is_blf {
            return (Self::Blf(Blf::new(source)), None);
        }
        if let Some(candump) = Candump::of(&lines) {
            return (Self::Candump(candump, source), None);
        }
        if let Some(asc) = Asc::of(&lines) {
            return (Self::Asc(asc, source), None);
        }
        if let Some(trc) = Trc::of(&lines) {
            return (Self::Trc(trc, source), None);
        }
        let found = (!is_empty).then_some(name);
        (Self::Candump(Candump::default(), source), found)
    }
}

/// The next line; none at the end.
fn line(source: &mut impl BufRead) -> io::Result<Option<String>> {
    let mut line = Vec::new();
    source.take(LONGEST_LINE).read_until(b'\n', &mut line)?;
    Ok((!line.is_empty()).then(|| String::from_utf8_lossy(&line).into_owned()))
}

impl<R: Read> Bus for LogBus<R> {
    fn receive(&mut self, _timeout: Duration) -> Result<Option<Received>, BusError> {
        while let Some(line) = self.next()? {
            if (self.interface.as_ref()).is_none_or(|name| *name == line.device) {
                self.now_us = line.t_us;
                return Ok(Some(Received {
                    t_us: line.t_us,
                    frame: line.frame,
                }));
            }
        }
        Err(BusError::Ended)
    }

    fn send(&mut self, _frame: &BusFrame) -> Result<(), BusError> {
        Err(io::Error::new(io::ErrorKind::Unsupported, "a log takes no frames").into())
    }

    fn restart(&mut self) -> Result<(), BusError> {
        Ok(())
    }

    fn now(&self) -> Duration {
        Duration::from_micros(self.now_us)
    }

    fn wait(&mut self, _time: Duration) {}

    fn malformed(&self) -> (u64, Option<u64>) {
        match &self.format {
            Format::Blf(blf) => blf.malformed(),
            _ => (self.malformed, self.first_malformed),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::standard;

    fn frames(bus: &mut LogBus<&[u8]>) -> Vec<Received> {
        let mut frames = Vec::new();
        while let Ok(received) = bus.receive(Duration::ZERO) {
            frames.push(received.expect("a log never times out"));
        }
        frames
    }

    #[test]
    fn what_is_no_log_is_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let refused = |bytes: &[u8]| {
            let path = folder.path().join("file");
            std::fs::write(&path, bytes).expect("written");
            LogBus::open(&path, None)
                .err()
                .map(|error| error.to_string())
        };
        for (bytes, name) in [
            (&b"t [s],ta1 [m/m]\n0,1\n"[..], "a table of text"),
            (b"PAR1\0\0", "a Parquet file"),
            (b"format = 1\n", "a TOML file"),
        ] {
            let message = refused(bytes).expect("refused");
            assert!(message.contains(name), "{message}");
        }
        assert_eq!(refused(b""), None);
        assert_eq!(refused(b"  can0  501   [2]  00 11\n"), None);
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
        let mut bus = LogBus::new(log.as_bytes(), Some("vcan0")).expect("read");
        let frames = frames(&mut bus);
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
        let lines = "(0.000001) can0 501#00112233\n(1.000000) can0 50F##4AABBCC\n(1.500000) can0 18FF0001#\n";
        let mut bus = LogBus::new(lines.as_bytes(), None).expect("read");
        let mut writer = LogWriter::create(&path, "can0").expect("created");
        for received in frames(&mut bus) {
            writer.write(&received).expect("written");
        }
        writer.finish().expect("written");
        assert_eq!(std::fs::read_to_string(&path).expect("read"), lines);
    }
}
