//! Writes the first line of a generated TOML file, with its kind and a CRC-32 of the text below,
//! and checks it to detect later edits.

use crc::{CRC_32_ISO_HDLC, Crc};

/// CRC-32 (ISO-HDLC) of the text below the mark.
const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// First part of the mark, before the kind.
const BEGINNING: &str = "# Written by loadtwin as ";

/// Second part of the mark, before the CRC as eight hex digits.
const BEFORE_SUM: &str = "; CRC-32 of what follows: ";

/// The TOML `text` with a first line that names its kind and holds the CRC-32 of the others; a line
/// of that sort that it had is left out.
pub fn marked(what: &str, text: &str) -> String {
    let text = match text.split_once('\n') {
        Some((first, rest)) if first.starts_with(BEGINNING) => rest,
        _ => text,
    };
    let sum = CRC.checksum(text.as_bytes());
    format!("{BEGINNING}{what}{BEFORE_SUM}{sum:08x}\n{text}")
}

/// Whether `text` is as [`marked`] gave it: what a person edits is the person's.
pub fn is_intact(what: &str, text: &[u8]) -> bool {
    let Some(end) = memchr::memchr(b'\n', text) else {
        return false;
    };
    let (first, rest) = text.split_at(end);
    let sum = CRC.checksum(&rest[1..]);
    first == format!("{BEGINNING}{what}{BEFORE_SUM}{sum:08x}").as_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edited_text_is_the_persons() {
        let text = marked("description", "a = 1\nb = 2\n");
        assert!(is_intact("description", text.as_bytes()));
        assert!(!is_intact("calibration", text.as_bytes()));
        assert!(!is_intact("description", text.replace('2', "3").as_bytes()));
        assert!(!is_intact("description", b"a = 1\nb = 2\n"));
        // Once more: one such line.
        assert_eq!(marked("description", &text), text);
        assert_eq!(text.lines().count(), 3);
    }
}
