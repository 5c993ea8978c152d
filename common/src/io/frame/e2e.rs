//! Protects the payload of a CAN frame by AUTOSAR E2E profile 5 (CRC, data ID and counter), checks
//! a received payload, and classifies its counter: in order, repeated, or how many frames were
//! lost.
//!
//! Byte 0 and 1: CRC, low byte first; byte 2: counter; then the data. The CRC
//! is CRC-16-CCITT-FALSE (polynomial 0x1021, start 0xFFFF) over everything
//! after it and the 16-bit Data ID, low byte first. Its Hamming distance is 4
//! over any frame here: all errors of 1, 2 and 3 bits are found.
//!
//! Source: AUTOSAR FO, "E2E Protocol Specification" (PRS), section "E2E profile 5".

use crc::{CRC_16_IBM_3740, Crc, Digest, Table};

use crate::io::frame::WIRE_VERSION;

/// CRC-16-CCITT-FALSE, called CRC-16/IBM-3740 in the catalogue of parametrised CRCs.
static CRC: Crc<u16, Table<1>> = Crc::<u16, Table<1>>::new(&CRC_16_IBM_3740);

/// Data ID of the frames with identifier `id`: no frame passes for one of
/// another identifier or wire version.
pub const fn data_id(id: u16) -> u16 {
    WIRE_VERSION << 11 | id
}

/// CRC over several pieces of bytes, then the data ID.
pub(crate) struct Check(Digest<'static, u16, Table<1>>);

impl Check {
    pub(crate) fn new() -> Self {
        Self(CRC.digest())
    }

    pub(crate) fn with(mut self, bytes: &[u8]) -> Self {
        self.0.update(bytes);
        self
    }

    pub(crate) fn finish(self, data_id: u16) -> u16 {
        self.with(&data_id.to_le_bytes()).0.finalize()
    }
}

/// Writes counter and CRC in front of the data.
pub fn protect<const N: usize>(data_id: u16, counter: u8, payload: &mut [u8; N]) {
    const { assert!(N > 3) }
    payload[2] = counter;
    let crc = Check::new().with(&payload[2..]).finish(data_id);
    let [low, high] = crc.to_le_bytes();
    payload[0] = low;
    payload[1] = high;
}

/// The counter, when the CRC fits.
pub fn check<const N: usize>(data_id: u16, payload: &[u8; N]) -> Option<u8> {
    const { assert!(N > 3) }
    let crc = Check::new().with(&payload[2..]).finish(data_id);
    (u16::from_le_bytes([payload[0], payload[1]]) == crc).then_some(payload[2])
}

/// Order of a frame after the one before it, by their counters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sequence {
    /// The first frame seen.
    First,
    /// The next one.
    Next,
    /// The same once more: repeated, or 256 were lost.
    Repeated,
    /// This many, 1 to 254, are missing before it; more where they were lost by the 256.
    Lost(u8),
}

/// The last counter received with one identifier.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counter {
    last: Option<u8>,
}

impl Counter {
    /// Takes the counter of the next frame that passed its check.
    pub fn follow(&mut self, counter: u8) -> Sequence {
        let step = self.last.map(|last| counter.wrapping_sub(last));
        self.last = Some(counter);
        match step {
            None => Sequence::First,
            Some(0) => Sequence::Repeated,
            Some(1) => Sequence::Next,
            Some(step) => Sequence::Lost(step - 1),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of the specification's example for profile 5 (Data ID 0x1234,
    /// counter 0, zeros), as the Python package `autosar-e2e` computes them too.
    #[test]
    fn the_example_of_the_specification() {
        let mut payload = [0; 8];
        protect(0x1234, 0, &mut payload);
        assert_eq!(payload, [0x1C, 0xCA, 0, 0, 0, 0, 0, 0]);
        assert_eq!(check(0x1234, &payload), Some(0));
    }

    #[test]
    fn every_error_of_up_to_three_bits_is_found() {
        let mut payload = [0, 0, 0, 0x3A, 0x5C, 0x91, 0xEF, 0x04];
        protect(0x0D01, 77, &mut payload);
        let sent = u64::from_le_bytes(payload);
        let found = |errors: u64| check(0x0D01, &(sent ^ errors).to_le_bytes()).is_none();
        let mut patterns = 0;
        for a in 0..64 {
            for b in a..64 {
                for c in b..64 {
                    // Equal positions are taken once: patterns of one and two bits.
                    if b == c && a != b {
                        continue;
                    }
                    assert!(found(1 << a | 1 << b | 1 << c), "bits {a} {b} {c}");
                    patterns += 1;
                }
            }
        }
        assert_eq!(patterns, 64 + 64 * 63 / 2 + 64 * 63 * 62 / 6);
    }

    #[test]
    fn a_frame_does_not_pass_for_one_of_another_identifier() {
        let mut payload = [1, 2, 3, 4, 5, 6, 7, 8];
        protect(data_id(0x501), 9, &mut payload);
        for id in (0..0x800).filter(|id| *id != 0x501) {
            assert_eq!(check(data_id(id), &payload), None, "{id:#x}");
        }
    }

    #[test]
    fn every_jump_of_the_counter_is_seen() {
        for start in 0..=255_u8 {
            for jump in 0..=255_u8 {
                let mut counter = Counter::default();
                assert_eq!(counter.follow(start), Sequence::First);
                let seen = counter.follow(start.wrapping_add(jump));
                match jump {
                    0 => assert_eq!(seen, Sequence::Repeated),
                    1 => assert_eq!(seen, Sequence::Next),
                    _ => assert_eq!(seen, Sequence::Lost(jump - 1)),
                }
            }
        }
    }
}
