//! Signs images for tests.

use ed25519_compact::{KeyPair, Seed};
use loadtwin_common::sealed::{CRC, Header, PublicKey};

/// A key pair; the same for the same seed.
pub fn pair(seed: u8) -> KeyPair {
    KeyPair::from_seed(Seed::new([seed; 32]))
}

/// The key that the board of a test has.
pub fn board_key() -> PublicKey {
    PublicKey::from_bytes(*pair(1).pk).unwrap()
}

/// A sealed image.
pub fn signed(payload: &[u8], issue: u32, replaces: u32, pair: &KeyPair) -> Vec<u8> {
    let mut header = Header::for_payload(payload, issue, replaces).unwrap();
    header.signature = *pair.sk.sign(header.signed_bytes(), None);
    let mut bytes = [&header.to_bytes()[..], payload].concat();
    bytes.extend(CRC.checksum(&bytes).to_le_bytes());
    bytes
}
