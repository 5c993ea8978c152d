//! Signing of images with a test key, for the tests of the store and of the upload.

use ed25519_compact::{KeyPair, Seed};
use loadtwin_common::io::signed_image::{CRC, Header, Identity, MachineId, PublicKey};

/// A key pair; the same for the same seed.
pub fn pair(seed: u8) -> KeyPair {
    KeyPair::from_seed(Seed::new([seed; 32]))
}

/// The board of a test.
pub fn board() -> Identity {
    Identity {
        key: PublicKey::from_bytes(*pair(1).pk).unwrap(),
        machine: MachineId::of("bench"),
    }
}

/// A sealed image for the machine of [`board`].
pub fn signed(payload: &[u8], issue: u32, replaces: u32, pair: &KeyPair) -> Vec<u8> {
    signed_for("bench", payload, issue, replaces, pair)
}

/// A sealed image for some machine.
pub fn signed_for(
    machine: &str,
    payload: &[u8],
    issue: u32,
    replaces: u32,
    pair: &KeyPair,
) -> Vec<u8> {
    let machine = MachineId::of(machine);
    let mut header = Header::for_payload(payload, machine, issue, replaces).unwrap();
    header.signature = *pair.sk.sign(header.signed_bytes(), None);
    let mut bytes = [&header.to_bytes()[..], payload].concat();
    bytes.extend(CRC.checksum(&bytes).to_le_bytes());
    bytes
}
