//! Parses the lines of ASC files, the text log of CAN buses by Vector's tools, into frames with
//! time and channel. Called by `log/mod.rs`, line by line, once the line `base hex` or `base dec`
//! is found.
//!
//! Classic: `   0.000200 1  109             Rx   d 8 2C CB 01 00 0F 6A FE FF`, FD: `   0.000400
//! CANFD   1 Rx        10F   1 0 d 32 00 ...`; an `x` behind the identifier is 29 bits.

use super::line_parsing::{Line, Parsed, bytes_of, number, time_us};
use crate::bus_frame::{BusFrame, FrameKind};

/// Bit of an FD line's flags: it is an FD frame. Lines of classic frames may be of this form, too.
const IS_FD: u32 = 0x1000;

/// Reads lines.
#[derive(Debug)]
pub(super) struct Asc {
    /// Base of identifiers and data.
    base: u32,
    /// Whether times count from the line before.
    is_relative: bool,
    now_us: u64,
}

impl Asc {
    /// A reader for a log that begins with `lines`; none where it is none.
    pub(super) fn of(lines: &[&str]) -> Option<Self> {
        let has = |start: &str| {
            lines
                .iter()
                .any(|line| line.trim_start().to_lowercase().starts_with(start))
        };
        (has("base hex") || has("base dec")).then_some(Self {
            base: 16,
            is_relative: false,
            now_us: 0,
        })
    }

    pub(super) fn parse(&mut self, line: &str) -> Parsed {
        let words: Vec<&str> = line.split_whitespace().collect();
        if words
            .first()
            .is_some_and(|word| word.eq_ignore_ascii_case("base"))
        {
            self.base = if words
                .get(1)
                .is_some_and(|word| word.eq_ignore_ascii_case("dec"))
            {
                10
            } else {
                16
            };
            self.is_relative = words
                .last()
                .is_some_and(|word| word.eq_ignore_ascii_case("relative"));
            return Parsed::Other;
        }
        let Some((t_us, words)) = words
            .split_first()
            .and_then(|(first, rest)| Some((time_us(first, 1e6)?, rest)))
        else {
            return if line
                .bytes()
                .all(|b| b.is_ascii_graphic() || b.is_ascii_whitespace())
            {
                Parsed::Other
            } else {
                Parsed::Malformed
            };
        };
        self.now_us = if self.is_relative {
            self.now_us + t_us
        } else {
            t_us
        };
        let is_event = |words: &[&str]| match words {
            [channel, event, ..] if number(channel, 10).is_some() => {
                *event == "Statistic:" || event.ends_with(':')
            }
            ["CANFD", ..] => false,
            _ => true,
        };
        let found = match words {
            ["CANFD", rest @ ..] => self.fd(rest),
            [channel, "ErrorFrame", ..] if number(channel, 10).is_some() => {
                error().map(|frame| (*channel, frame))
            }
            words if is_event(words) => return Parsed::Other,
            words => self.classic(words),
        };
        found.map_or(Parsed::Malformed, |(channel, frame)| {
            Parsed::Frame(Line {
                t_us: self.now_us,
                device: channel.to_owned(),
                frame,
            })
        })
    }

    /// `1  109x  Rx  d 8 2C ...`
    fn classic<'a>(&self, words: &[&'a str]) -> Option<(&'a str, BusFrame)> {
        let [channel, id, "Rx" | "Tx" | "TxRq", kind, rest @ ..] = words else {
            return None;
        };
        let (id, is_extended) = self.identifier(id)?;
        let frame = match (*kind, rest.split_first()) {
            ("r", None) => BusFrame::remote(id, is_extended, 0)?,
            ("r", Some((length, _))) => {
                BusFrame::remote(id, is_extended, number(length, 16).unwrap_or(0) as u8)?
            }
            ("d", Some((length, data))) => {
                let length = number(length, 16)? as usize;
                let data = bytes_of(data.get(..length)?.iter().copied(), self.base)?;
                BusFrame::new(FrameKind::Data, id, is_extended, &data)?
            }
            _ => return None,
        };
        Some((channel, frame))
    }

    /// `1 Rx  10F  [name] 1 0 d 32 00 ... duration length flags ...`
    fn fd<'a>(&self, words: &[&'a str]) -> Option<(&'a str, BusFrame)> {
        let [channel, "Rx" | "Tx" | "TxRq", id, rest @ ..] = words else {
            return None;
        };
        if *id == "ErrorFrame" {
            return Some((channel, error()?));
        }
        let (id, is_extended) = self.identifier(id)?;
        let is_flag = |word: Option<&&str>| matches!(word, Some(&"0" | &"1"));
        // A name may stand between.
        let rest = if is_flag(rest.first()) && is_flag(rest.get(1)) {
            rest
        } else {
            rest.get(1..)?
        };
        let [rate, passive, _code, length, data @ ..] = rest else {
            return None;
        };
        let flags = number(rate, 2)? as u8 | (number(passive, 2)? as u8) << 1;
        let length: usize = length.parse().ok()?;
        let stated = data.get(length + 2).and_then(|word| number(word, 16));
        let data = bytes_of(data.get(..length)?.iter().copied(), self.base)?;
        let kind = if stated.is_none_or(|stated| stated & IS_FD != 0) {
            FrameKind::Fd { flags }
        } else {
            FrameKind::Data
        };
        Some((channel, BusFrame::new(kind, id, is_extended, &data)?))
    }

    fn identifier(&self, text: &str) -> Option<(u32, bool)> {
        match text.strip_suffix(['x', 'X']) {
            Some(id) => Some((number(id, self.base)?, true)),
            None => Some((number(text, self.base)?, false)),
        }
    }
}

/// An error frame, of which the log has no cause.
fn error() -> Option<BusFrame> {
    BusFrame::new(FrameKind::Error, 0, false, &[0; 8])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(asc: &mut Asc, line: &str) -> String {
        match asc.parse(line) {
            Parsed::Frame(line) => format!("{} {} {}", line.t_us, line.device, line.frame),
            other => format!("{other:?}"),
        }
    }

    #[test]
    fn frames_and_events() {
        let mut asc = Asc::of(&[
            "date Thu Nov 26 10:00:00 2026",
            "base hex  timestamps absolute",
        ])
        .unwrap();
        for (line, expected) in [
            ("base hex  timestamps absolute", "Other"),
            ("internal events logged", "Other"),
            ("Begin Triggerblock Fri May 03 10:00:00.0 2024", "Other"),
            ("   0.000000 Start of measurement", "Other"),
            (
                "   0.000200 1  109             Rx   d 8 2C CB 01 00 0F 6A FE FF  Length = 0 BitCount = 0 ID = 265",
                "200 1 109#2CCB01000F6AFEFF",
            ),
            ("   0.5 2  18FF0001x       Tx   d 0", "500000 2 18FF0001#"),
            ("   0.5 1  109             Rx   r 8", "500000 1 109#R8"),
            ("   0.5 1  ErrorFrame", "500000 1 20000000#0000000000000000"),
            ("   0.5 1  Statistic: D 0 R 0", "Other"),
            (
                "   0.6 CANFD   1 Rx        10F                                   1 0 9 12 \
              00 01 02 03 04 05 06 07 08 09 0A 0B   102000  0   3000 0 0 0 0 0",
                "600000 1 10F##1000102030405060708090A0B",
            ),
            (
                "   0.6 CANFD   1 Rx        10F  Name  0 0 1  1 AB   102000  0   1000 0 0 0 0 0",
                "600000 1 10F##0AB",
            ),
            (
                "   0.6 CANFD   1 Rx        10F  0 0 1  1 AB   102000  0   0 0 0 0 0 0",
                "600000 1 10F#AB",
            ),
            ("   0.7 1  109             Rx   d 8 2C CB 01", "Malformed"),
            ("   0.7 1  FFFFF           Rx   d 0", "Malformed"),
            ("End TriggerBlock", "Other"),
        ] {
            assert_eq!(shown(&mut asc, line), expected, "{line}");
        }
        let mut relative = Asc::of(&["base dec timestamps relative"]).unwrap();
        relative.parse("base dec timestamps relative");
        relative.parse("0.1 1 16 Rx d 1 255");
        assert_eq!(
            shown(&mut relative, "0.1 1 16 Rx d 1 255"),
            "200000 1 010#FF"
        );
        assert!(Asc::of(&["t [s],a [m]"]).is_none());
    }
}
