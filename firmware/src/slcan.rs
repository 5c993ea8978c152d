//! Encodes CAN frames as lines of text on a serial line and decodes them byte by byte, in the
//! format of Linux's `slcan` driver.
//!
//! `tIII8DDDDDDDDDDDDDDDD` and a carriage return: `t`, three hex digits of a
//! standard identifier, the length, two hex digits a byte. Every frame of this
//! project has 8 bytes; others, and the commands with which `slcand` opens and
//! closes the channel, are let pass.

use heapless::Vec;
use loadtwin_common::io::frame::Frame;

/// Longest line with its carriage return: `t7FF8` and eight bytes.
pub const LONGEST: usize = 22;

const HEX: &[u8; 16] = b"0123456789ABCDEF";

/// The line of a frame.
pub fn encode(frame: &Frame) -> Vec<u8, LONGEST> {
    let nibble = |n: u16| HEX[usize::from(n & 0xF)];
    [
        b't',
        nibble(frame.id >> 8),
        nibble(frame.id >> 4),
        nibble(frame.id),
        b'8',
    ]
    .into_iter()
    .chain(
        frame
            .data
            .iter()
            .flat_map(|byte| [nibble(u16::from(*byte) >> 4), nibble(u16::from(*byte))]),
    )
    .chain([b'\r'])
    .collect()
}

/// What a line was.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Line {
    /// A classic data frame of 8 bytes with a standard identifier.
    Frame(Frame),
    /// A command of `slcand`, or a frame of another kind.
    Other,
    /// No line of this protocol.
    Malformed,
}

/// Puts lines together from single bytes.
#[derive(Debug, Default)]
pub struct Decoder {
    line: Vec<u8, 32>,
    too_long: bool,
}

impl Decoder {
    /// Takes one byte; gives a line where the byte ended one.
    pub fn push(&mut self, byte: u8) -> Option<Line> {
        if byte != b'\r' {
            self.too_long |= self.line.push(byte).is_err();
            return None;
        }
        let line = if self.too_long {
            Some(Line::Malformed)
        } else {
            decode(&self.line)
        };
        self.line.clear();
        self.too_long = false;
        line
    }
}

fn decode(line: &[u8]) -> Option<Line> {
    let (kind, rest) = line.split_first()?;
    Some(match kind {
        b't' => data_frame(rest).unwrap_or(Line::Malformed),
        b'T' | b'r' | b'R' | b'O' | b'C' | b'S' | b's' | b'F' | b'V' | b'L' | b'N' | b'Z' => {
            Line::Other
        }
        _ => Line::Malformed,
    })
}

fn data_frame(digits: &[u8]) -> Option<Line> {
    let mut digits = digits.iter().map(|digit| char::from(*digit).to_digit(16));
    let mut next = |count| (0..count).try_fold(0, |value, _| Some(value << 4 | digits.next()??));
    let id = next(3).filter(|id| *id < 0x800)? as u16;
    let len = next(1).filter(|len| *len <= 8)?;
    let mut data = [0; 8];
    for byte in data.iter_mut().take(len as usize) {
        *byte = next(2)? as u8;
    }
    if digits.next().is_some() {
        return None;
    }
    Some(if len == 8 {
        Line::Frame(Frame { id, data })
    } else {
        Line::Other
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(bytes: &[u8]) -> std::vec::Vec<Line> {
        let mut decoder = Decoder::default();
        bytes
            .iter()
            .filter_map(|byte| decoder.push(*byte))
            .collect()
    }

    const FRAME: Frame = Frame {
        id: 0x7AF,
        data: [0xDE, 0xAD, 0xBE, 0xEF, 0, 1, 2, 0x7F],
    };
    const TEXT: &[u8] = b"t7AF8DEADBEEF0001027F\r";

    #[test]
    fn a_frame_is_the_text_that_linux_expects() {
        assert_eq!(encode(&FRAME), TEXT);
    }

    #[test]
    fn text_is_a_frame_in_either_case_of_its_digits() {
        assert_eq!(lines(TEXT), [Line::Frame(FRAME)]);
        assert_eq!(lines(b"t7af8deadbeef0001027f\r"), [Line::Frame(FRAME)]);
    }

    #[test]
    fn what_slcand_sends_to_open_the_channel_is_let_pass() {
        assert_eq!(lines(b"C\rS6\rO\r\r"), vec![Line::Other; 3]);
    }

    #[test]
    fn frames_of_other_kinds_are_let_pass() {
        let text = b"t1234DEADBEEF\rt1230\rr1238\rT000001238DEADBEEF0001027F\r";
        assert_eq!(lines(text), vec![Line::Other; 4]);
    }

    #[test]
    fn damaged_lines_are_named_and_the_next_one_is_whole() {
        for bad in [
            "t123",
            "t12",
            "t1239001122334455667788",
            "t1232001",
            "t12320",
            "t8000",
            "t12G0",
            "t1231\u{e9}",
            "x",
            "t12380011223344556677889900112233445566",
        ] {
            let text = [bad.as_bytes(), b"\r", TEXT].concat();
            assert_eq!(lines(&text), [Line::Malformed, Line::Frame(FRAME)], "{bad}");
        }
    }
}
