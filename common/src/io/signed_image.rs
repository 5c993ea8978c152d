//! Writes and checks the header of a sealed image, the signed container of a model image for upload
//! and flash: machine, issue, digest, Ed25519 signature, CRC. Opens whole images, gives the reason
//! and code of a refusal, and encodes a board's key page (`Identity`).
//!
//! All integers little endian.
//!
//! | offset  | bytes | field                                                          |
//! |---------|-------|----------------------------------------------------------------|
//! | 0       | 4     | magic `LTMI`                                                   |
//! | 4       | 4     | version of this container, 2                                   |
//! | 8       | 4     | issue: rises with every image that its signer publishes        |
//! | 12      | 4     | replaces: issue of a newer image that this one may replace, or 0 |
//! | 16      | 4     | length L of the payload, > 0                                   |
//! | 20      | 8     | machine that the image is for, see [`MachineId`]               |
//! | 28      | 32    | SHA-256 of the payload                                         |
//! | 60      | 64    | Ed25519 signature (RFC 8032) over bytes 0..60; zeros: unsigned |
//! | 124     | L     | payload: the postcard of the model                             |
//! | 124 + L | 4     | CRC-32 (ISO-HDLC) over everything before                       |
//!
//! The signature covers the payload through its digest, so that a board can
//! refuse a forged or an older image, or one for another machine, on its first
//! 124 bytes.
//!
//! The permission to go back is bound to the issue that is to be replaced. A
//! bare flag could be recorded once and replayed for ever.
//!
//! An unsigned image is for the host only, see [`open`]. A board takes an image
//! only with [`open_signed`] or [`Header::verify`]; without a key it takes none.

use core::fmt;

use crc::{CRC_32_ISO_HDLC, Crc, Table};
use sha2::{Digest, Sha256};

/// First bytes of every sealed image.
pub const MAGIC: [u8; 4] = *b"LTMI";
/// Version of the container; another one is refused.
pub const VERSION: u32 = 2;
/// Length of the part of the header that the signature covers (bytes).
pub const SIGNED_LEN: usize = 60;
/// Length of the header with its signature (bytes).
pub const HEADER_LEN: usize = 124;
/// What the container adds to a payload (bytes).
pub const OVERHEAD: usize = HEADER_LEN + 4;

/// First bytes of a key page.
const KEY_MAGIC: [u8; 4] = *b"LTP2";
/// Length of an [`Identity`] as it is written to the board's key page (bytes).
pub const KEY_PAGE_LEN: usize = 48;

/// CRC-32 of the container and of everything that rests beside it in flash.
pub const CRC: Crc<u32, Table<1>> = Crc::<u32, Table<1>>::new(&CRC_32_ISO_HDLC);

/// Why an image was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum ImageError {
    /// Does not start with [`MAGIC`].
    BadMagic,
    /// Another version of the container.
    BadVersion,
    /// Truncated, followed by something, empty, or not the announced length.
    BadLength,
    /// The CRC does not fit: damaged on the way or in the flash.
    BadCrc,
    /// The payload is not the one that was signed.
    BadDigest,
    /// Carries no signature.
    Unsigned,
    /// The signature is not by the board's key.
    BadSignature,
    /// The board has no key.
    NoKey,
    /// Not newer than the running image, and not signed to replace it.
    Downgrade,
    /// Does not fit into a slot.
    TooLong,
    /// The model inside is refused: its version or a range.
    BadModel,
    /// The flash could not be erased, written or read back.
    Flash,
    /// An image was accepted before; the board has to start it first.
    RestartPending,
    /// Signed for another machine than the board's.
    WrongMachine,
    /// Another sample rate, more channels or encoders, or another counter than the board has.
    WrongHardware,
}

impl ImageError {
    /// Every reason, in the order of their codes.
    pub const ALL: [Self; 15] = [
        Self::BadMagic,
        Self::BadVersion,
        Self::BadLength,
        Self::BadCrc,
        Self::BadDigest,
        Self::Unsigned,
        Self::BadSignature,
        Self::NoKey,
        Self::Downgrade,
        Self::TooLong,
        Self::BadModel,
        Self::Flash,
        Self::RestartPending,
        Self::WrongMachine,
        Self::WrongHardware,
    ];

    /// Code on the bus, 0xF0..=0xFE: the range that ISO 14229-1 leaves to the
    /// maker for negative responses.
    pub fn code(self) -> u8 {
        0xF0 + self as u8
    }

    /// The reason behind a code on the bus.
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.get(usize::from(code.checked_sub(0xF0)?)).copied()
    }
}

impl fmt::Display for ImageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::BadMagic => "not a model image",
            Self::BadVersion => "another version of the image container",
            Self::BadLength => "truncated image, or not of the announced length",
            Self::BadCrc => "damaged image: the CRC does not fit",
            Self::BadDigest => "the model is not the one that was signed",
            Self::Unsigned => "the image is not signed",
            Self::BadSignature => "signed with another key, or changed after signing",
            Self::NoKey => "the board has no key",
            Self::Downgrade => "not newer than the running image, and not signed to replace it",
            Self::TooLong => "the image does not fit into a slot",
            Self::BadModel => "the model in the image is refused: its version or a range",
            Self::Flash => "the flash could not be erased, written or read back",
            Self::RestartPending => "an image accepted before waits for a restart",
            Self::WrongMachine => {
                "the image is for another machine than the one in the board's key page"
            }
            Self::WrongHardware => {
                "the board has another sample rate, fewer channels or encoders, or another counter than the image needs"
            }
        })
    }
}

impl core::error::Error for ImageError {}

/// A key that images are checked with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PublicKey([u8; 32]);

impl PublicKey {
    /// Takes a key; `None` when it is no point of the curve or of small order,
    /// for which anyone can forge signatures.
    pub fn from_bytes(bytes: [u8; 32]) -> Option<Self> {
        ed25519_compact::PublicKey::new(bytes).validate().ok()?;
        Some(Self(bytes))
    }

    /// The 32 bytes of RFC 8032.
    pub fn as_bytes(&self) -> &[u8; 32] {
        &self.0
    }
}

/// Names one machine: the first 8 bytes of the SHA-256 of its identifier in UTF-8.
///
/// The identifier is the `id` of the description, its `name` where it has no `id`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MachineId([u8; 8]);

impl MachineId {
    /// The machine with this identifier.
    pub fn of(identifier: &str) -> Self {
        let digest: [u8; 32] = Sha256::digest(identifier.as_bytes()).into();
        let mut id = [0; 8];
        put(&mut id, 0, &digest);
        Self(id)
    }
}

/// What a board was given once: the key that it checks images with, and the machine that it is on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Images are signed with its private key.
    pub key: PublicKey,
    /// Images are for this machine.
    pub machine: MachineId,
}

impl Identity {
    /// What is written to the board's key page: `LTP2`, the key, the machine, a CRC-32.
    pub fn to_page(&self) -> [u8; KEY_PAGE_LEN] {
        let mut page = [0; KEY_PAGE_LEN];
        let (head, crc) = page.split_at_mut(KEY_PAGE_LEN - 4);
        put(head, 0, &KEY_MAGIC);
        put(head, 4, &self.key.0);
        put(head, 36, &self.machine.0);
        put(crc, 0, &CRC.checksum(head).to_le_bytes());
        page
    }

    /// The identity in a key page; `None` for a blank or damaged page.
    pub fn from_page(page: &[u8]) -> Option<Self> {
        let (head, rest) = page.split_at_checked(KEY_PAGE_LEN - 4)?;
        if !head.starts_with(&KEY_MAGIC) || u32_at(rest, 0)? != CRC.checksum(head) {
            return None;
        }
        Some(Self {
            key: PublicKey::from_bytes(array_at(head, 4)?)?,
            machine: MachineId(array_at(head, 36)?),
        })
    }
}

/// What stands before the payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Header {
    /// Rises with every image that its signer publishes.
    pub issue: u32,
    /// Issue of a newer image that this one may replace; 0: of none.
    pub replaces: u32,
    /// Length of the payload (bytes).
    pub length: u32,
    /// The machine that the image is for.
    pub machine: MachineId,
    /// SHA-256 of the payload; its first bytes name the model in status frames.
    pub digest: [u8; 32],
    /// Ed25519 over [`Header::signed_bytes`]; zeros when unsigned.
    pub signature: [u8; 64],
}

impl Header {
    /// The header of a payload, still unsigned.
    ///
    /// `None` when the payload is empty or longer than a container can hold.
    pub fn for_payload(
        payload: &[u8],
        machine: MachineId,
        issue: u32,
        replaces: u32,
    ) -> Option<Self> {
        let length = u32::try_from(payload.len()).ok()?;
        let header = Self {
            issue,
            replaces,
            length,
            machine,
            digest: Sha256::digest(payload).into(),
            signature: [0; 64],
        };
        (length > 0 && header.image_len().is_some()).then_some(header)
    }

    /// Reads a header; what follows it is left alone.
    ///
    /// # Errors
    /// `BadMagic`, `BadVersion`, and `BadLength` for fewer than [`HEADER_LEN`]
    /// bytes or a length of the payload that cannot be.
    pub fn parse(bytes: &[u8]) -> Result<Self, ImageError> {
        let short = ImageError::BadLength;
        if array_at::<4>(bytes, 0).ok_or(short)? != MAGIC {
            return Err(ImageError::BadMagic);
        }
        if u32_at(bytes, 4).ok_or(short)? != VERSION {
            return Err(ImageError::BadVersion);
        }
        let header = Self {
            issue: u32_at(bytes, 8).ok_or(short)?,
            replaces: u32_at(bytes, 12).ok_or(short)?,
            length: u32_at(bytes, 16).ok_or(short)?,
            machine: MachineId(array_at(bytes, 20).ok_or(short)?),
            digest: array_at(bytes, 28).ok_or(short)?,
            signature: array_at(bytes, SIGNED_LEN).ok_or(short)?,
        };
        if header.length == 0 || header.image_len().is_none() {
            return Err(short);
        }
        Ok(header)
    }

    /// The bytes that the signature covers.
    pub fn signed_bytes(&self) -> [u8; SIGNED_LEN] {
        let mut bytes = [0; SIGNED_LEN];
        put(&mut bytes, 0, &MAGIC);
        put(&mut bytes, 4, &VERSION.to_le_bytes());
        put(&mut bytes, 8, &self.issue.to_le_bytes());
        put(&mut bytes, 12, &self.replaces.to_le_bytes());
        put(&mut bytes, 16, &self.length.to_le_bytes());
        put(&mut bytes, 20, &self.machine.0);
        put(&mut bytes, 28, &self.digest);
        bytes
    }

    /// The header as it stands in an image.
    pub fn to_bytes(&self) -> [u8; HEADER_LEN] {
        let mut bytes = [0; HEADER_LEN];
        put(&mut bytes, 0, &self.signed_bytes());
        put(&mut bytes, SIGNED_LEN, &self.signature);
        bytes
    }

    /// Length of the whole image (bytes); `None` when it does not fit 32 bits.
    pub fn image_len(&self) -> Option<u32> {
        self.length.checked_add(OVERHEAD as u32)
    }

    /// Whether the header is signed for a board of this identity.
    ///
    /// # Errors
    /// `NoKey`, `Unsigned`, `WrongMachine`, `BadSignature`.
    pub fn verify(&self, board: Option<&Identity>) -> Result<(), ImageError> {
        let board = board.ok_or(ImageError::NoKey)?;
        if self.signature == [0; 64] {
            return Err(ImageError::Unsigned);
        }
        if self.machine != board.machine {
            return Err(ImageError::WrongMachine);
        }
        ed25519_compact::PublicKey::new(board.key.0)
            .verify(
                self.signed_bytes(),
                &ed25519_compact::Signature::new(self.signature),
            )
            .map_err(|_| ImageError::BadSignature)
    }

    /// Whether this image may take the place of the running one.
    ///
    /// The same issue again is refused too: a recorded upload changes nothing.
    ///
    /// # Errors
    /// `Downgrade` when `running` is of the same or a later issue and is not
    /// the one that this image is signed to replace.
    pub fn may_replace(&self, running: Option<&Self>) -> Result<(), ImageError> {
        match running {
            Some(r) if self.issue == r.issue => Err(ImageError::Downgrade),
            Some(r) if self.issue < r.issue && self.replaces != r.issue => {
                Err(ImageError::Downgrade)
            }
            _ => Ok(()),
        }
    }
}

/// Check of a payload that arrives in pieces, as when it is read from flash.
#[derive(Clone)]
pub struct PayloadHash {
    crc: crc::Digest<'static, u32, Table<1>>,
    sha: Sha256,
    digest: [u8; 32],
    missing: u32,
}

impl fmt::Debug for PayloadHash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "PayloadHash {{ missing: {} }}", self.missing)
    }
}

impl PayloadHash {
    /// Starts behind the header.
    pub fn new(header: &Header) -> Self {
        static TABLE: Crc<u32, Table<1>> = CRC;
        let mut crc = TABLE.digest();
        crc.update(&header.to_bytes());
        Self {
            crc,
            sha: Sha256::new(),
            digest: header.digest,
            missing: header.length,
        }
    }

    /// Takes the next piece of the payload; what is beyond its end is ignored.
    pub fn hash(&mut self, piece: &[u8]) {
        let take = piece.len().min(self.missing as usize);
        let piece = piece.get(..take).unwrap_or_default();
        self.crc.update(piece);
        self.sha.update(piece);
        self.missing -= take as u32;
    }

    /// CRC-32 over header and payload.
    pub fn crc(&self) -> u32 {
        self.crc.clone().finalize()
    }

    /// Checks the payload by the CRC behind it and the digest in the header.
    ///
    /// # Errors
    /// `BadLength` when bytes are missing, `BadCrc`, `BadDigest`.
    pub fn finish(self, crc: u32) -> Result<(), ImageError> {
        if self.missing != 0 {
            return Err(ImageError::BadLength);
        }
        if self.crc.finalize() != crc {
            return Err(ImageError::BadCrc);
        }
        let digest: [u8; 32] = self.sha.finalize().into();
        if digest != self.digest {
            return Err(ImageError::BadDigest);
        }
        Ok(())
    }
}

/// Opens a whole image without asking who signed it: for reading on the host.
///
/// Gives the header and the payload.
///
/// # Errors
/// As [`Header::parse`] and [`PayloadHash::finish`]; `BadLength` also for bytes
/// behind the end.
pub fn open(bytes: &[u8]) -> Result<(Header, &[u8]), ImageError> {
    let header = Header::parse(bytes)?;
    if header.image_len().and_then(|n| usize::try_from(n).ok()) != Some(bytes.len()) {
        return Err(ImageError::BadLength);
    }
    let (payload, crc) = bytes
        .get(HEADER_LEN..)
        .and_then(|rest| rest.split_last_chunk::<4>())
        .ok_or(ImageError::BadLength)?;
    let mut content = PayloadHash::new(&header);
    content.hash(payload);
    content.finish(u32::from_le_bytes(*crc))?;
    Ok((header, payload))
}

/// Opens a whole image that has to be signed for a board of this identity.
///
/// # Errors
/// As [`open`] and [`Header::verify`].
pub fn open_signed<'a>(
    bytes: &'a [u8],
    board: Option<&Identity>,
) -> Result<(Header, &'a [u8]), ImageError> {
    let opened = open(bytes)?;
    opened.0.verify(board)?;
    Ok(opened)
}

fn array_at<const N: usize>(bytes: &[u8], at: usize) -> Option<[u8; N]> {
    bytes.get(at..)?.first_chunk().copied()
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    array_at(bytes, at).map(u32::from_le_bytes)
}

/// Copies `source` to `target[at..]`, as far as it fits.
fn put(target: &mut [u8], at: usize, source: &[u8]) {
    for (t, s) in target.iter_mut().skip(at).zip(source) {
        *t = *s;
    }
}
