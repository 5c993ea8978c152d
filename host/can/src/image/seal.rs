//! Packs the bytes of a model into a sealed image (`seal`): a header with machine, issue number and
//! signature, the model, a CRC. Boards accept signed images; without a key the image is for the
//! host only.

use loadtwin_common::io::signed_image::{CRC, Header, MachineId};
use thiserror::Error;

use crate::image::key::SigningKey;

/// The payload is empty or does not fit a container.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("found a model of {0} bytes, allowed: 1 to 4294967175")]
pub struct SealError(pub usize);

/// Seals a payload; without a key the image is for the host only.
///
/// `machine`: identifier of the machine that the image is for; `issue`: rises with every image that
/// the signer publishes; `replaces`: the issue of a newer image that this one may replace on a
/// board.
///
/// ```
/// use loadtwin_can::image::{key::SigningKey, seal::seal};
/// use loadtwin_common::io::signed_image::open_signed;
///
/// let key = SigningKey::generate()?;
/// let image = seal(b"model", "bench", 7, None, Some(&key))?;
/// let (header, payload) = open_signed(&image, Some(&key.identity("bench")))?;
/// assert_eq!((header.issue, payload), (7, &b"model"[..]));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`SealError`].
pub fn seal(
    payload: &[u8],
    machine: &str,
    issue: u32,
    replaces: Option<u32>,
    key: Option<&SigningKey>,
) -> Result<Vec<u8>, SealError> {
    let mut header = Header::for_payload(
        payload,
        MachineId::of(machine),
        issue,
        replaces.unwrap_or(0),
    )
    .ok_or(SealError(payload.len()))?;
    if let Some(key) = key {
        header.signature = key.sign(&header.signed_bytes());
    }
    let mut image = [&header.to_bytes()[..], payload].concat();
    image.extend(CRC.checksum(&image).to_le_bytes());
    Ok(image)
}
