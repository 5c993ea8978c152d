//! Writes and reads the commit records of a slot in flash, each a counter with a CRC over it and
//! the signature of the slot's image: the slot with the highest valid counter is in force.

use embedded_storage::nor_flash::NorFlash;
use loadtwin_common::io::signed_image::{CRC, Header, ImageError};

use super::{Active, Slot, Store};

/// Length of a commit record [bytes]: counter and CRC-32 over the counter and
/// the signature of the image, little endian.
pub(super) const RECORD_LEN: usize = 8;
/// A record's place after an erase.
const BLANK: [u8; RECORD_LEN] = [0xFF; RECORD_LEN];

/// Content of the record page of a slot.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Records {
    pub counter: Option<u32>,
    anchored: bool,
    /// First pair with nothing but blank pairs from there on.
    pub free: u32,
}

impl<F: NorFlash> Store<F> {
    /// Pairs of records in a page.
    const PAIRS: u32 = Self::PAGE / (2 * RECORD_LEN as u32);

    /// The record that puts `header` in force under this counter.
    fn record(counter: u32, header: &Header) -> [u8; RECORD_LEN] {
        let counter = counter.to_le_bytes();
        let mut digest = CRC.digest();
        digest.update(&counter);
        digest.update(&header.signature);
        let mut record = [0; RECORD_LEN];
        let crc = digest.finalize().to_le_bytes();
        for (r, b) in record.iter_mut().zip(counter.iter().chain(&crc)) {
            *r = *b;
        }
        record
    }

    pub(super) fn records(&mut self, slot: Slot, header: &Header) -> Records {
        let mut found = Records::default();
        for pair in 0..Self::PAIRS {
            let [first, second] = self.places(slot, pair).map(|at| self.read_record(at));
            for word in [first, second].into_iter().flatten() {
                let [c0, c1, c2, c3, ..] = word;
                let counter = u32::from_le_bytes([c0, c1, c2, c3]);
                if word != BLANK && word == Self::record(counter, header) {
                    found.counter = found.counter.max(Some(counter));
                    found.anchored |= Some(word) == first && second != Some(BLANK);
                }
            }
            if first != Some(BLANK) || second != Some(BLANK) {
                found.free = pair + 1;
            }
        }
        found
    }

    /// Offsets of the two records of a pair.
    fn places(&self, slot: Slot, pair: u32) -> [u32; 2] {
        let first = self.records_at(slot) + pair * 2 * RECORD_LEN as u32;
        [first, first + RECORD_LEN as u32]
    }

    /// Reads word by word: after an unreadable word the next may be readable.
    fn read_record(&mut self, at: u32) -> Option<[u8; RECORD_LEN]> {
        let mut word = [0; RECORD_LEN];
        self.flash.read(at, &mut word).ok().map(|()| word)
    }

    /// Makes sure that a complete record stands in the slot, and shows as such.
    pub(super) fn anchor(&mut self, active: &Active) -> Result<(), ImageError> {
        let records = self.records(active.slot, &active.header);
        if records.anchored {
            Ok(())
        } else {
            self.append(active, records.free)
        }
    }

    /// Writes the first pair from `free` on that takes it.
    pub(super) fn append(&mut self, active: &Active, free: u32) -> Result<(), ImageError> {
        let record = Self::record(active.counter, &active.header);
        for pair in free..Self::PAIRS {
            let [first, second] = self.places(active.slot, pair);
            if self.flash.write(first, &record).is_ok() && self.read_record(first) == Some(record) {
                // In force by now. Should the second fail, the next `anchor`
                // writes another pair.
                let _ = self.flash.write(second, &record);
                return Ok(());
            }
        }
        Err(ImageError::Flash)
    }
}
