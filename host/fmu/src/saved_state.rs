//! Byte format of the saved state of an FMU instance: mark, state of the estimator with inputs and
//! outputs (postcard), CRC-32.

use serde::{Deserialize, Serialize};

use crate::instance::Progress;
use crate::refusal::Refusal;

/// First bytes: name and version of the layout.
const MARK: &[u8] = b"loadtwin fmu state 1\n";

/// CRC-32 (ISO-HDLC) over all before it.
const CRC: crc::Crc<u32, crc::Table<1>> =
    crc::Crc::<u32, crc::Table<1>>::new(&crc::CRC_32_ISO_HDLC);

/// What is saved.
#[derive(Serialize, Deserialize)]
pub(crate) struct State {
    /// That of the estimator, as in `replay --state-out` and on the board.
    pub line: Vec<u8>,
    pub progress: Progress,
}

impl State {
    pub fn to_bytes(&self) -> Result<Vec<u8>, Refusal> {
        let mut bytes = MARK.to_vec();
        let body = postcard::to_stdvec(self);
        bytes.extend(body.map_err(|_| Refusal::State("it cannot be written"))?);
        bytes.extend(CRC.checksum(&bytes).to_le_bytes());
        Ok(bytes)
    }

    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Refusal> {
        const MALFORMED: Refusal =
            Refusal::State("none, damaged, or of another version; allowed: a whole one");
        let (body, crc) = bytes.split_last_chunk::<4>().ok_or(MALFORMED)?;
        if CRC.checksum(body) != u32::from_le_bytes(*crc) {
            return Err(MALFORMED);
        }
        let body = body.strip_prefix(MARK).ok_or(MALFORMED)?;
        match postcard::take_from_bytes(body) {
            Ok((state, [])) => Ok(state),
            _ => Err(MALFORMED),
        }
    }
}
