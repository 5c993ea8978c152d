//! Writes the counts of a load to bytes with version and checksum, and continues counting from such
//! bytes after a restart (`LoadCounts::save`, `LoadCounts::continued`).

use super::load_counts::LoadCounts;
use crate::Error;
use crate::saved_bytes::Seal;

/// Version of the layout of saved counts; another one is refused.
pub const VERSION: u16 = 1;

/// Most bytes of saved counts: every counter at its longest in postcard, 5 bytes
/// for 4 and 10 for 8.
pub const MAX_BYTES: usize = 5 * size_of::<LoadCounts>() / 4 + 512;

/// Version and error names of saved counts.
const COUNTS: Seal = Seal {
    version: VERSION,
    name: "saved counts",
    version_name: "version of saved counts",
};

impl LoadCounts {
    /// Settles the counts, writes them to `bytes` and gives how many it took: version,
    /// counts (postcard), CRC-32 (ISO-HDLC, little endian) of all before it.
    ///
    /// # Errors
    /// `Error::OutOfRange` when `bytes` is too short; [`MAX_BYTES`] are enough.
    pub fn save(&mut self, bytes: &mut [u8]) -> Result<usize, Error> {
        self.settle();
        COUNTS.write(&*self, bytes)
    }

    /// Continues saved counts to the bit.
    ///
    /// # Errors
    /// `Error::Malformed` when the bytes are not whole saved counts of this
    /// version, or are a state that no sequence leads to.
    pub fn continued(bytes: &[u8]) -> Result<Self, Error> {
        let counts: Self = COUNTS.read(bytes)?;
        if counts.is_valid() {
            Ok(counts)
        } else {
            Err(Error::Malformed(COUNTS.name))
        }
    }
}
