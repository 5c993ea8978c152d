//! Types and number parsers that the log readers share: a frame with time and interface (`Line`),
//! the result of parsing one line (`Parsed`), and text to hexadecimal numbers, bytes and
//! microseconds.

use crate::bus_frame::BusFrame;

/// A frame of a log.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Line {
    /// Time (us).
    pub(super) t_us: u64,
    /// The interface or channel.
    pub(super) device: String,
    pub(super) frame: BusFrame,
}

/// What a line of a log is.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Parsed {
    Frame(Line),
    /// A head, a comment or an event without a frame.
    Other,
    /// No line of this format.
    Malformed,
}

/// A number of hexadecimal digits alone.
pub(super) fn hex(text: &str) -> Option<u32> {
    let is_hex = !text.is_empty() && text.bytes().all(|b| b.is_ascii_hexdigit());
    u32::from_str_radix(text, 16).ok().filter(|_| is_hex)
}

/// A number of digits of `base` alone.
pub(super) fn number(text: &str, base: u32) -> Option<u32> {
    let is_number = !text.is_empty() && text.bytes().all(|b| b.is_ascii_alphanumeric());
    u32::from_str_radix(text, base).ok().filter(|_| is_number)
}

/// Bytes written as one word each.
pub(super) fn bytes_of<'a>(words: impl Iterator<Item = &'a str>, base: u32) -> Option<Vec<u8>> {
    words
        .map(|word| number(word, base).and_then(|byte| u8::try_from(byte).ok()))
        .collect()
}

/// Seconds (or milliseconds, by `unit_us`) as microseconds.
pub(super) fn time_us(text: &str, unit_us: f64) -> Option<u64> {
    let time: f64 = text.parse().ok()?;
    let us = (time * unit_us).round();
    (us.is_finite() && (0.0..1e18).contains(&us)).then_some(us as u64)
}
