//! Reads the model image and `machine.toml` from the resources folder of an FMU. Computes the token
//! that binds the model description to them, the SHA-256 of both files.

use std::path::Path;

use loadtwin_files::bounded;
use loadtwin_files::hex::hex;
use sha2::{Digest, Sha256};

use crate::refusal::Refusal;

/// The model image, as `loadtwin build -o` writes it.
pub const IMAGE: &str = "machine.image";

/// [`crate::interface::Interface`].
pub const INTERFACE: &str = "machine.toml";

/// No resource is larger (bytes).
const LARGEST: u64 = 1 << 20;

/// Both files.
#[derive(Clone, Debug)]
pub struct Resources {
    /// The sealed model image.
    pub image: Vec<u8>,
    /// The description.
    pub interface: String,
}

impl Resources {
    /// Reads both files in `folder`.
    ///
    /// # Errors
    /// When one cannot be read or is larger than the command writes it.
    pub fn read(folder: &Path) -> Result<Self, Refusal> {
        let read = |name| {
            let path = folder.join(name);
            bounded::read(&path, LARGEST).map_err(|error| Refusal::Resource {
                path: path.display().to_string(),
                reason: error.to_string(),
            })
        };
        Ok(Self {
            image: read(IMAGE)?,
            interface: String::from_utf8(read(INTERFACE)?).map_err(|_| Refusal::Text(INTERFACE))?,
        })
    }

    /// Digest of both files (SHA-256, hexadecimal): `instantiationToken`, `guid`.
    pub fn token(&self) -> String {
        let mut digest = Sha256::new();
        digest.update((self.image.len() as u64).to_le_bytes());
        digest.update(&self.image);
        digest.update(&self.interface);
        hex(digest.finalize())
    }
}
