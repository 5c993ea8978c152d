//! Writes saved states and saved counts to bytes and reads them back (`Seal`): version, value
//! (postcard), CRC-32 (ISO-HDLC, little endian) of all before it.

use crc::{CRC_32_ISO_HDLC, Crc, Table};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::Error;

/// Bytes of the CRC at the end.
const CRC_LEN: usize = 4;

/// CRC-32 (ISO-HDLC), as of the sealed image.
const CRC: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&CRC_32_ISO_HDLC);

/// A kind of bytes.
#[derive(Clone, Copy)]
pub(crate) struct Seal {
    /// Version of the layout; another one is refused.
    pub version: u16,
    /// What the bytes are, in an error.
    pub name: &'static str,
    /// The version of it, in an error.
    pub version_name: &'static str,
}

impl Seal {
    /// Writes `value` to `bytes` and gives how many it took.
    ///
    /// # Errors
    /// `Error::OutOfRange` when `bytes` is too short.
    pub(crate) fn write<T: Serialize>(self, value: &T, bytes: &mut [u8]) -> Result<usize, Error> {
        let too_short = Error::OutOfRange(self.name);
        let len = postcard::to_slice(&(self.version, value), bytes)
            .map_err(|_| too_short)?
            .len();
        let crc = CRC.checksum(&bytes[..len]).to_le_bytes();
        let end = bytes.get_mut(len..len + CRC_LEN).ok_or(too_short)?;
        end.copy_from_slice(&crc);
        Ok(len + CRC_LEN)
    }

    /// The value in `bytes`.
    ///
    /// # Errors
    /// `Error::Malformed` when the bytes are not whole, or of another version.
    pub(crate) fn read<T: DeserializeOwned>(self, bytes: &[u8]) -> Result<T, Error> {
        match postcard::take_from_bytes(self.body(bytes)?) {
            Ok((value, [])) => Ok(value),
            _ => Err(Error::Malformed(self.name)),
        }
    }

    /// The first part of it.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub(crate) fn read_first<T: DeserializeOwned>(self, bytes: &[u8]) -> Result<T, Error> {
        let first = postcard::take_from_bytes(self.body(bytes)?);
        first
            .map(|(value, _)| value)
            .map_err(|_| Error::Malformed(self.name))
    }

    /// What follows the version, without the CRC.
    fn body(self, bytes: &[u8]) -> Result<&[u8], Error> {
        let malformed = Error::Malformed(self.name);
        let (body, crc) = bytes.split_last_chunk::<CRC_LEN>().ok_or(malformed)?;
        if CRC.checksum(body) != u32::from_le_bytes(*crc) {
            return Err(malformed);
        }
        let (version, rest) = postcard::take_from_bytes::<u16>(body).map_err(|_| malformed)?;
        if version == self.version {
            Ok(rest)
        } else {
            Err(Error::Malformed(self.version_name))
        }
    }
}
