//! Counts as bytes, to continue them after a restart.

use crc::{CRC_32_ISO_HDLC, Crc, Table};

use super::load_counts::LoadCounts;
use crate::Error;

/// Version of the layout of saved counts; another one is refused.
pub const VERSION: u16 = 1;

/// Bytes of the CRC at the end.
const CRC_LEN: usize = 4;

/// Most bytes of saved counts: every counter at its longest in postcard, 5 bytes
/// for 4 and 10 for 8.
pub const MAX_BYTES: usize = 5 * size_of::<LoadCounts>() / 4 + 512;

const CRC: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&CRC_32_ISO_HDLC);

impl LoadCounts {
    /// Settles the counts, writes them to `bytes` and gives how many it took: version,
    /// counts (postcard), CRC-32 (ISO-HDLC, little endian) of all before it.
    ///
    /// # Errors
    /// `Error::OutOfRange` when `bytes` is too short; [`MAX_BYTES`] are enough.
    pub fn save(&mut self, bytes: &mut [u8]) -> Result<usize, Error> {
        self.settle();
        let too_short = Error::OutOfRange("bytes of saved counts");
        let len = postcard::to_slice(&(VERSION, &*self), bytes)
            .map_err(|_| too_short)?
            .len();
        let crc = CRC.checksum(&bytes[..len]).to_le_bytes();
        let end = bytes.get_mut(len..len + CRC_LEN).ok_or(too_short)?;
        end.copy_from_slice(&crc);
        Ok(len + CRC_LEN)
    }

    /// Continues saved counts to the bit.
    ///
    /// # Errors
    /// `Error::Malformed` when the bytes are not whole saved counts of this
    /// version, or are a state that no sequence leads to.
    pub fn continued(bytes: &[u8]) -> Result<Self, Error> {
        let malformed = Error::Malformed("saved counts");
        let (body, crc) = bytes.split_last_chunk::<CRC_LEN>().ok_or(malformed)?;
        if CRC.checksum(body) != u32::from_le_bytes(*crc) {
            return Err(malformed);
        }
        let (version, rest) = postcard::take_from_bytes::<u16>(body).map_err(|_| malformed)?;
        if version != VERSION {
            return Err(Error::Malformed("version of saved counts"));
        }
        match postcard::take_from_bytes::<Self>(rest) {
            Ok((counts, [])) if counts.is_valid() => Ok(counts),
            _ => Err(malformed),
        }
    }
}
