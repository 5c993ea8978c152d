//! Parses lines of `candump` (can-utils), as logged (`-L`, `-l`) or as printed, into frames with
//! time and interface. Time stamps may be absolute, steps or dates; a line without one has the time
//! of the line before.
//!
//! | written by | a line |
//! |---|---|
//! | `-L`, `-l` | `(1436509052.249713) can0 501#0011` |
//! | none | `  can0  501   [2]  00 11` |
//! | `-ta`, `-tz`, `-td` | ` (1436509052.249713)  can0  501   [2]  00 11` |
//! | `-tA` | ` (2015-07-10 06:17:32.249713)  can0  501   [2]  00 11` |
//! | `-x`, `-a` | ` (0.2)  can0  RX - -  501   [2]  00 11   '..'` |

use super::line_parsing::{Line, Parsed, bytes_of, hex};
use crate::bus_frame::{BusFrame, ERROR_FLAG, FrameKind};

/// Longest step of stamps that count from the frame before (us).
const LONGEST_STEP_US: u64 = 10_000_000;

/// Reads lines.
#[derive(Debug, Default)]
pub(super) struct Candump {
    /// Whether stamps count from the frame before (`-td`).
    counts_steps: bool,
    now_us: u64,
}

impl Candump {
    /// A reader for a log that begins with `lines`; none where no line is a frame.
    pub(super) fn of(lines: &[&str]) -> Option<Self> {
        let stamps: Vec<u64> = lines.iter().filter_map(|line| frame(line)?.0).collect();
        let is_one = lines.iter().any(|line| frame(line).is_some());
        // Absolute stamps hardly ever run backwards, steps do in every other line.
        let back = stamps.windows(2).filter(|pair| pair[1] < pair[0]).count();
        let counts_steps =
            4 * back >= stamps.len().max(8) && stamps.iter().all(|t| *t < LONGEST_STEP_US);
        is_one.then_some(Self {
            counts_steps,
            now_us: 0,
        })
    }

    pub(super) fn parse(&mut self, line: &str) -> Parsed {
        let Some((stamp, device, frame)) = frame(line) else {
            return Parsed::Malformed;
        };
        match stamp {
            Some(step) if self.counts_steps => self.now_us += step,
            Some(t_us) => self.now_us = t_us,
            None => {}
        }
        Parsed::Frame(Line {
            t_us: self.now_us,
            device: device.to_owned(),
            frame,
        })
    }
}

/// Stamp, device and frame of a line.
fn frame(line: &str) -> Option<(Option<u64>, &str, BusFrame)> {
    let line = line.trim();
    let (stamp, rest) = match line.strip_prefix('(') {
        Some(stamped) => {
            let (stamp, rest) = stamped.split_once(')')?;
            (Some(stamp_us(stamp)?), rest)
        }
        None => (None, line),
    };
    let mut words = rest.split_whitespace();
    let device = words.next()?;
    let mut id = words.next()?;
    if id.contains('#') {
        return Some((stamp, device, compact(id)?));
    }
    if matches!(id, "RX" | "TX") {
        // Then the flags B (two rates) and E, or -.
        words.next().filter(|flag| flag.len() == 1)?;
        words.next().filter(|flag| flag.len() == 1)?;
        id = words.next()?;
    }
    let length = words.next()?.strip_prefix('[')?.strip_suffix(']')?;
    let is_fd = length.len() == 2;
    let count: usize = length.parse().ok()?;
    let (raw, is_extended) = identifier(id)?;
    let rest: Vec<&str> = words.collect();
    let frame = if rest.first() == Some(&"remote") {
        BusFrame::remote(raw, is_extended, count as u8)?
    } else {
        let data = bytes_of(rest.get(..count)?.iter().copied(), 16)?;
        let is_ended = rest
            .get(count)
            .is_none_or(|next| next.starts_with('\'') || *next == "ERRORFRAME");
        made(raw, is_extended, is_fd.then_some(0), &data).filter(|_| is_ended)?
    };
    Some((stamp, device, frame))
}

/// `501#0011`, `501##10011`, `501#R8`, with `_C` behind the data for a raw length code.
fn compact(text: &str) -> Option<BusFrame> {
    let (id, data) = text.split_once('#')?;
    let (raw, is_extended) = identifier(id)?;
    if let Some(length) = data.strip_prefix('R') {
        let length = length.split('_').next()?;
        let length = if length.is_empty() {
            0
        } else {
            length.parse().ok()?
        };
        return BusFrame::remote(raw, is_extended, length);
    }
    let (flags, data) = match data.strip_prefix('#') {
        Some(fd) => (Some(hex(fd.get(..1)?)? as u8), fd.get(1..)?),
        None => (None, data.split('_').next()?),
    };
    let digits: String = data.chars().filter(|c| *c != '.').collect();
    if !digits.is_ascii() || !digits.len().is_multiple_of(2) {
        return None;
    }
    let pairs = (0..digits.len())
        .step_by(2)
        .filter_map(|at| digits.get(at..at + 2));
    made(raw, is_extended, flags, &bytes_of(pairs, 16)?)
}

fn made(raw: u32, is_extended: bool, fd_flags: Option<u8>, data: &[u8]) -> Option<BusFrame> {
    match fd_flags {
        Some(flags) => BusFrame::new(FrameKind::Fd { flags }, raw, is_extended, data),
        None if is_extended && raw & ERROR_FLAG != 0 => {
            BusFrame::new(FrameKind::Error, raw & !ERROR_FLAG, false, data)
        }
        None => BusFrame::new(FrameKind::Data, raw, is_extended, data),
    }
}

/// An identifier and whether it has 29 bits: eight digits.
fn identifier(text: &str) -> Option<(u32, bool)> {
    matches!(text.len(), 3 | 8).then_some((hex(text)?, text.len() == 8))
}

/// A stamp in microseconds: seconds, or a date and a time of day.
fn stamp_us(text: &str) -> Option<u64> {
    let (days, text) = match text.split_once(' ') {
        Some((date, time)) => (days(date)?, time),
        None => (0, text),
    };
    let (whole, part) = text.split_once('.').unwrap_or((text, ""));
    let seconds = whole.split(':').try_fold(0_u64, |sum, digits| {
        sum.checked_mul(60)?.checked_add(digits.parse().ok()?)
    })?;
    let part = if part.is_empty() {
        0
    } else if part.bytes().all(|b| b.is_ascii_digit()) {
        format!("{part:0<6}").get(..6)?.parse().ok()?
    } else {
        return None;
    };
    (days * 86_400 + seconds)
        .checked_mul(1_000_000)?
        .checked_add(part)
}

/// Days from 1970-01-01 to a date of the Gregorian calendar.
fn days(date: &str) -> Option<u64> {
    let mut parts = date.split('-').map(|part| part.parse::<u64>().ok());
    let (year, month, day) = (parts.next()??, parts.next()??, parts.next()??);
    let is_date =
        (1970..3000).contains(&year) && (1..=12).contains(&month) && (1..=31).contains(&day);
    // The year begins in March, so that the leap day is its last.
    let (year, month) = if month < 3 {
        (year - 1, month + 9)
    } else {
        (year, month - 3)
    };
    let days = year * 365 + year / 4 - year / 100 + year / 400 + (153 * month + 2) / 5 + day;
    is_date.then(|| days.checked_sub(719_469)).flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(line: &str) -> Option<(Option<u64>, String)> {
        frame(line).map(|(stamp, device, frame)| (stamp, format!("{device} {frame}")))
    }

    #[test]
    fn lines_of_every_kind() {
        for (line, stamp, shown) in [
            (
                "(1436509052.249713) vcan0 501#0011 R",
                Some(1_436_509_052_249_713),
                "vcan0 501#0011",
            ),
            (
                "(000.000200789) can0 50F##0AABB",
                Some(200),
                "can0 50F##0AABB",
            ),
            ("  can0  501   [2]  00 11", None, "can0 501#0011"),
            (
                " (2015-07-10 06:17:32.249713)  can0  501   [0]",
                Some(1_436_509_052_249_713),
                "can0 501#",
            ),
            (
                " (0.2)  can0  RX - -  501   [2]  00 11   '..'",
                Some(200_000),
                "can0 501#0011",
            ),
            (
                "can0  TX B -  12345678  [08]  00 11 22 33 44 55 66 77",
                None,
                "can0 12345678##00011223344556677",
            ),
            ("can0  123   [8]  remote request", None, "can0 123#R8"),
            (
                "can0  20000004   [8]  00 0C 00 00 00 00 00 00   ERRORFRAME",
                None,
                "can0 20000004#000C000000000000",
            ),
            ("(1.0) can0 123#11.22", Some(1_000_000), "can0 123#1122"),
            (
                "(1.0) can0 123#1122334455667788_B",
                Some(1_000_000),
                "can0 123#1122334455667788",
            ),
        ] {
            assert_eq!(read(line), Some((stamp, shown.to_owned())), "{line}");
        }
        for line in [
            "",
            "not a frame",
            "(1.0) can0 501#001",
            "(1.0) can0 5011#00",
            "(x) can0 501#00",
            "can0  501   [3]  00 11",
            "can0  501   [2]  00 11 22",
            "(1.0) can0",
            "t [s],ta1 [m/m]",
            "(1.0) can0 501#0é",
        ] {
            assert_eq!(read(line), None, "{line}");
        }
    }

    #[test]
    fn steps_are_summed_up() {
        let lines: Vec<String> = (0..20)
            .map(|i| format!("(000.00{:02}00) can0 501#00", 2 + 7 * (i % 2)))
            .collect();
        let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
        let mut candump = Candump::of(&lines).unwrap();
        let last = lines.iter().map(|line| candump.parse(line)).last();
        assert!(matches!(last, Some(Parsed::Frame(line)) if line.t_us == 10 * 200 + 10 * 900));
        let mut absolute = Candump::of(&["(1.0) can0 501#00", "(2.0) can0 501#00"]).unwrap();
        absolute.parse("(1.0) can0 501#00");
        assert!(
            matches!(absolute.parse("(2.0) can0 501#00"), Parsed::Frame(l) if l.t_us == 2_000_000)
        );
        assert!(Candump::of(&["x"]).is_none());
    }
}
