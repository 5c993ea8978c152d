//! Finds what the argument SOURCE of the CAN commands names (`Source`: a CAN interface of Linux, a
//! serial adapter `slcan:PORT@BIT_RATE` or a log file), and opens it as a `Bus`.

use std::path::Path;

use super::CanError;
use super::bus::Bus;
use super::log::LogBus;
use super::slcan::SlcanBus;

/// Begin of the name of a serial adapter.
const SLCAN: &str = "slcan:";

/// Bit rate of a serial adapter where none is stated (bit/s).
const BIT_RATE: u32 = 500_000;

/// Ends of the names of logs of a bus.
const LOGS: [&str; 4] = ["log", "asc", "blf", "trc"];

/// Interface in a log that is written of no interface.
pub const DEVICE: &str = "can0";

/// What a name stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source<'a> {
    /// A CAN interface of Linux.
    Interface(&'a str),
    /// A serial adapter and its bit rate (bit/s).
    Slcan(&'a str, u32),
    /// A log.
    Log(&'a Path),
}

impl<'a> Source<'a> {
    /// What `name` stands for: `slcan:PORT@BIT_RATE`, an interface of the system, a file where it is
    /// there or the name has a slash or a dot, else an interface that is not there.
    ///
    /// # Errors
    /// When the bit rate is no number.
    pub fn of(name: &'a str) -> Result<Self, CanError> {
        if let Some(adapter) = name.strip_prefix(SLCAN) {
            let (port, rate) = match adapter.rsplit_once('@') {
                Some((port, rate)) => (port, rate.parse().ok()),
                None => (adapter, Some(BIT_RATE)),
            };
            let rate = rate.ok_or_else(|| CanError::Name {
                found: name.to_owned(),
            })?;
            return Ok(Self::Slcan(port, rate));
        }
        let path = Path::new(name);
        let is_named = name.contains(['/', '\\']);
        let is_interface = !is_named && Path::new("/sys/class/net").join(name).exists();
        let is_path = is_named || name.contains('.') || path.exists();
        Ok(if is_path && !is_interface {
            Self::Log(path)
        } else {
            Self::Interface(name)
        })
    }

    /// The bus that `path` stands for, or its log; none for a recording.
    ///
    /// # Errors
    /// As [`Self::of`].
    pub fn of_path(path: &'a Path) -> Result<Option<Self>, CanError> {
        let Some(name) = path.to_str() else {
            return Ok(None);
        };
        let source = Self::of(name)?;
        let end = path.extension().and_then(|end| end.to_str());
        let is_bus = source.log().is_none() || end.is_some_and(|end| LOGS.contains(&end));
        Ok(is_bus.then_some(source))
    }

    /// The log, where it is one.
    pub fn log(self) -> Option<&'a Path> {
        match self {
            Self::Log(path) => Some(path),
            _ => None,
        }
    }

    /// Name of the interface in a log that is written.
    pub fn device(self) -> &'a str {
        match self {
            Self::Interface(name) => name,
            Self::Slcan(..) | Self::Log(_) => DEVICE,
        }
    }

    /// Opens it; with `block`, an interface for the 32 identifiers from there; with `device`, a log
    /// for the frames of that interface.
    ///
    /// # Errors
    /// When it cannot be opened, or the file is no log.
    pub fn open(self, block: Option<u16>, device: Option<&str>) -> Result<Box<dyn Bus>, CanError> {
        match self {
            Self::Log(path) => Ok(Box::new(LogBus::open(path, device)?)),
            Self::Slcan(port, rate) => Ok(Box::new(SlcanBus::open(port, rate)?)),
            Self::Interface(name) => interface(name, block),
        }
    }
}

#[cfg(target_os = "linux")]
fn interface(name: &str, block: Option<u16>) -> Result<Box<dyn Bus>, CanError> {
    Ok(Box::new(super::socketcan::SocketBus::open(name, block)?))
}

#[cfg(not(target_os = "linux"))]
fn interface(name: &str, _block: Option<u16>) -> Result<Box<dyn Bus>, CanError> {
    Err(CanError::Open {
        interface: name.to_owned(),
        source: std::io::Error::new(
            std::io::ErrorKind::Unsupported,
            "no CAN interfaces on this system",
        ),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_every_kind() {
        let file = tempfile::NamedTempFile::new().expect("a file");
        let log = file.path().to_str().expect("a name");
        for (name, expected) in [
            ("can7", Source::Interface("can7")),
            (
                "slcan:/dev/ttyACM0@250000",
                Source::Slcan("/dev/ttyACM0", 250_000),
            ),
            ("slcan:COM3", Source::Slcan("COM3", 500_000)),
            ("absent.log", Source::Log(Path::new("absent.log"))),
            (log, Source::Log(file.path())),
        ] {
            assert_eq!(Source::of(name).expect("a source"), expected);
        }
        assert!(Source::of("slcan:/dev/ttyACM0@fast").is_err());
    }
}
