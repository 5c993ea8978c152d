//! Evaluates a periodic function of an angle from a table that is read in place from a model image
//! (`PeriodicLookup`): value and slope, linear between the entries, or the value of a bin.

use serde::{Deserialize, Serialize};

use crate::Error;
use crate::signal::phase::Phase;

/// A periodic function over one turn: 2^k equally spaced f32, little endian,
/// left where the image lies (flash) and read entry by entry.
///
/// A table costs the same for any shape of map and less than the sine and
/// cosine that harmonics begin with; a ring gear's gauge would need 48 orders.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PeriodicLookup<'a> {
    #[serde(borrow)]
    bytes: &'a [u8],
}

/// Largest k of a table of 2^k entries.
pub const MAX_LOG2_LEN: u32 = 12;

impl<'a> PeriodicLookup<'a> {
    /// A table over `bytes`, 4 for each entry.
    ///
    /// # Errors
    /// `Error::OutOfRange` when the number of entries is not a power of two of
    /// at most 4096; `Error::NotFinite` when an entry is not finite.
    pub fn try_new(bytes: &'a [u8], name: &'static str) -> Result<Self, Error> {
        Self { bytes }.validate(name).map(|()| Self { bytes })
    }

    /// Checks a table that came out of an image.
    ///
    /// # Errors
    /// As [`PeriodicLookup::try_new`].
    pub fn validate(&self, name: &'static str) -> Result<(), Error> {
        let entries = self.bytes.len() / 4;
        if !self.bytes.len().is_multiple_of(4)
            || !entries.is_power_of_two()
            || entries.trailing_zeros() > MAX_LOG2_LEN
        {
            return Err(Error::OutOfRange(name));
        }
        if (0..entries).any(|i| !self.entry(i).is_finite()) {
            return Err(Error::NotFinite(name));
        }
        Ok(())
    }

    /// Entry `i`, modulo nothing; 0 beyond the end.
    pub fn entry(&self, i: usize) -> f32 {
        let (entries, _) = self.bytes.as_chunks::<4>();
        entries
            .get(i)
            .map_or(0.0, |bytes| f32::from_le_bytes(*bytes))
    }

    /// Number of entries.
    pub fn len(&self) -> usize {
        self.bytes.len() / 4
    }

    /// Whether there are no entries; never so after validation.
    pub fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// Value and slope [1/rad] at `angle`, linear between the entries.
    pub fn at(&self, angle: Phase) -> (f32, f32) {
        let entries = self.len();
        let (i, fraction) = angle.table_index(entries.trailing_zeros());
        let left = self.entry(i);
        let right = self.entry(if i + 1 < entries { i + 1 } else { 0 });
        let rise = right - left;
        (
            left + fraction * rise,
            rise * (entries as f32 * (0.5 * core::f32::consts::FRAC_1_PI)),
        )
    }

    /// The entry whose bin holds `angle`; bin i covers the turn from i / n to (i + 1) / n.
    pub fn bin(&self, angle: Phase) -> f32 {
        self.entry(angle.table_index(self.len().trailing_zeros()).0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes() -> [u8; 16] {
        let mut bytes = [0; 16];
        for (chunk, value) in bytes
            .as_chunks_mut::<4>()
            .0
            .iter_mut()
            .zip([1.0_f32, 3.0, 5.0, 3.0])
        {
            *chunk = value.to_le_bytes();
        }
        bytes
    }

    #[test]
    fn between_entries_the_table_is_linear_and_periodic() {
        let bytes = bytes();
        let table = PeriodicLookup::try_new(&bytes, "map").unwrap();
        assert_eq!(table.at(Phase(0)).0, 1.0);
        assert_eq!(table.at(Phase(1 << 61)).0, 2.0);
        assert_eq!(table.at(Phase(7 << 61)).0, 2.0);
        // 2 per quarter turn.
        assert!((table.at(Phase(0)).1 - 4.0 / core::f32::consts::PI).abs() < 1e-6);
        assert_eq!(table.bin(Phase(7 << 61)), 3.0);
    }

    #[test]
    fn a_malformed_table_is_refused() {
        let bytes = bytes();
        assert_eq!(
            PeriodicLookup::try_new(&bytes[..12], "map"),
            Err(Error::OutOfRange("map"))
        );
        assert_eq!(
            PeriodicLookup::try_new(&bytes[..15], "map"),
            Err(Error::OutOfRange("map"))
        );
        assert_eq!(
            PeriodicLookup::try_new(&[], "map"),
            Err(Error::OutOfRange("map"))
        );
        let nan = f32::NAN.to_le_bytes();
        assert_eq!(
            PeriodicLookup::try_new(&nan, "map"),
            Err(Error::NotFinite("map"))
        );
    }
}
