//! Holds what goes from one day of a machine to the next (`CarriedState`): the estimator's state as
//! bytes, the time of the last sample (s), and the counts of load cycles since the first day.
//! Writes it to the file `_state` beside the day's estimates; reads it only if its SHA-256 is that
//! of the day's row.

use std::path::Path;

use loadtwin_files::hex::hex;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::load_counting::SavedCounts;
use crate::{ArchiveError, complete_file};

/// Name of the file beside the estimates of a day; engines pass over names with this first letter.
const NAME: &str = "_state";

/// First bytes of the file: name and version of its layout.
const MARK: &[u8] = b"loadtwin state of a day 1\n";

/// State at the end of a day.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct CarriedState {
    /// State of the estimator.
    pub(crate) estimator: Option<Vec<u8>>,
    /// Time of the last sample (s).
    pub(crate) end_s: Option<f64>,
    /// Hash of the description that it belongs to.
    pub(crate) description_sha256: String,
    /// Counts of load cycles by load, since the first day.
    pub(crate) counts: SavedCounts,
}

impl CarriedState {
    fn to_bytes(&self) -> Result<Vec<u8>, ArchiveError> {
        postcard::to_extend(self, MARK.to_vec()).map_err(|error| ArchiveError::refused(NAME, error))
    }

    /// Hash of the bytes.
    ///
    /// # Errors
    /// [`ArchiveError::Refused`] when it cannot be given as bytes.
    pub(crate) fn sha256(&self) -> Result<String, ArchiveError> {
        Ok(hex(Sha256::digest(self.to_bytes()?)))
    }

    /// Writes it beside the estimates of its day; its hash.
    ///
    /// # Errors
    /// [`ArchiveError`] when it cannot be written.
    pub(crate) fn write(&self, folder: &Path) -> Result<String, ArchiveError> {
        let bytes = self.to_bytes()?;
        complete_file::write_hashed(&folder.join(NAME), &bytes)?;
        Ok(hex(Sha256::digest(bytes)))
    }

    /// Reads the state of a day; none where there is none with this hash.
    pub(crate) fn read(folder: &Path, sha256: &str) -> Option<Self> {
        let bytes = std::fs::read(folder.join(NAME)).ok()?;
        if hex(Sha256::digest(&bytes)) != sha256 {
            return None;
        }
        postcard::from_bytes(bytes.strip_prefix(MARK)?).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_state_is_read_as_it_was_written_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let state = CarriedState {
            estimator: Some(vec![1, 2]),
            end_s: Some(0.1 + 0.2),
            counts: [("shaft".to_owned(), vec![3])].into(),
            ..CarriedState::default()
        };
        let sha256 = state.write(folder.path()).unwrap();
        assert_eq!(sha256, state.sha256().unwrap());
        assert_eq!(CarriedState::read(folder.path(), &sha256), Some(state));
        std::fs::write(folder.path().join(NAME), "cut").unwrap();
        assert_eq!(CarriedState::read(folder.path(), &sha256), None);
    }
}
