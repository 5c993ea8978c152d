//! Generates Ed25519 key pairs (RFC 8032), reads and writes them as PEM files, and signs the header
//! of model images. Also writes the key page of a board: public key and machine identity. Existing
//! files are not overwritten.
//!
//! Kept as PEM (PKCS #8 and `SubjectPublicKeyInfo`, RFC 8410), so that OpenSSL
//! makes, reads and guards them as well.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use ed25519_compact::{KeyPair, Seed};
use loadtwin_common::io::signed_image::{Identity, MachineId, PublicKey, SIGNED_LEN};
use loadtwin_files::atomic_file::{AtomicFile, Complete, publish};
use loadtwin_files::bounded;
use loadtwin_files::file_kind::FileKind;
use rand::TryRng;
use rand::rngs::SysRng;
use thiserror::Error;

/// Largest file of a key (bytes); one has 120.
const LARGEST_KEY: u64 = 1 << 20;

/// Kind of a key file.
pub const KEY: FileKind = FileKind {
    noun: "key",
    suffixes: &["pem", "key", "pub", "page"],
    is_same: |_| Ok(false),
};

/// Why a key cannot be made or read; one line.
#[derive(Debug, Error)]
pub enum KeyError {
    /// Nothing is overwritten: what a lost key has signed cannot be replaced.
    #[error("{}: is there already; a key is never overwritten", .0.display())]
    Exists(PathBuf),
    /// The file cannot be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// It is not the key that was asked for.
    #[error("{}: found no {expected}", path.display())]
    Form {
        /// The file.
        path: PathBuf,
        /// What it has to be.
        expected: &'static str,
    },
    /// Others can read the private key.
    #[error("{}: found mode {mode:04o}, allowed: no access for others (chmod 600)", path.display())]
    Exposed {
        /// The file.
        path: PathBuf,
        /// Its permission bits.
        mode: u32,
    },
    /// The system gives no random numbers.
    #[error("no random numbers from the system: {0}")]
    Random(#[from] rand::rngs::SysError),
    /// The random numbers gave a key that anyone can forge for.
    #[error("the system's random numbers gave a weak key; try again")]
    Weak,
}

/// A private key. Not printed, wiped when dropped.
pub struct SigningKey {
    pair: KeyPair,
    public: PublicKey,
}

/// The files of a new key pair.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KeyFiles {
    /// The private key, PEM, mode 0600.
    pub private: PathBuf,
    /// The public key, PEM.
    pub public: PathBuf,
    /// The board's key page: the public key and the machine, binary.
    pub page: PathBuf,
}

impl KeyFiles {
    /// Their names.
    pub fn all(&self) -> [&Path; 3] {
        [&self.private, &self.public, &self.page]
    }
}

/// The mode of a file to which others have access.
#[cfg(unix)]
fn open_to_others(permissions: &fs::Permissions) -> Option<u32> {
    use std::os::unix::fs::PermissionsExt;
    let mode = permissions.mode() & 0o777;
    (mode & 0o077 != 0).then_some(mode)
}

/// Other systems guard a file by its folder.
#[cfg(not(unix))]
fn open_to_others(_permissions: &fs::Permissions) -> Option<u32> {
    None
}

impl SigningKey {
    /// A new key from the system's random numbers.
    ///
    /// # Errors
    /// `KeyError::Random`, `KeyError::Weak`.
    pub fn generate() -> Result<Self, KeyError> {
        let mut seed = Seed::new([0; 32]);
        SysRng.try_fill_bytes(&mut seed[..])?;
        // A public key of small order has odds of 2^-252; then, as for a failing
        // source: no key.
        Self::new(KeyPair::from_seed(seed)).ok_or(KeyError::Weak)
    }

    /// Reads a private key.
    ///
    /// # Errors
    /// `KeyError::File`, `KeyError::Exposed`, `KeyError::Form`.
    pub fn read(path: &Path) -> Result<Self, KeyError> {
        let failed = |source| file_error(path, source);
        let permissions = fs::metadata(path).map_err(failed)?.permissions();
        if let Some(mode) = open_to_others(&permissions) {
            return Err(KeyError::Exposed {
                path: path.into(),
                mode,
            });
        }
        let pair = KeyPair::from_pem(&read_text(path)?).ok();
        pair.and_then(Self::new).ok_or_else(|| KeyError::Form {
            path: path.into(),
            expected: "Ed25519 private key in PEM",
        })
    }

    fn new(pair: KeyPair) -> Option<Self> {
        let public = PublicKey::from_bytes(*pair.pk)?;
        Some(Self { pair, public })
    }

    /// The key that boards check with.
    pub fn public(&self) -> PublicKey {
        self.public
    }

    /// What a board on this machine is given.
    pub fn identity(&self, machine: &str) -> Identity {
        identity(self.public, machine)
    }

    /// Signs an image's header.
    pub fn sign(&self, header: &[u8; SIGNED_LEN]) -> [u8; 64] {
        *self.pair.sk.sign(header, None)
    }

    /// The files of the pair whose private key is `private`.
    pub fn files(private: &Path) -> KeyFiles {
        let beside = |suffix: &str| {
            let mut name = private.as_os_str().to_owned();
            name.push(suffix);
            PathBuf::from(name)
        };
        KeyFiles {
            private: private.into(),
            public: beside(".pub"),
            page: beside(".page"),
        }
    }

    /// The key page beside the key in `private`, where it is that of another machine than
    /// `machine`: a board with this page refuses the machine's images.
    pub fn page_of_another_machine(private: &Path, machine: &str) -> Option<PathBuf> {
        let page = Self::files(private).page;
        let bytes = bounded::read(&page, LARGEST_KEY).ok()?;
        let other = Identity::from_page(&bytes)?.machine != MachineId::of(machine);
        other.then_some(page)
    }

    /// Writes the pair to `private` and `private`.pub, and the key page of the board on
    /// `machine` to `private`.page.
    ///
    /// # Errors
    /// `KeyError::Exists` when one of them is there, `KeyError::File`; none is
    /// left behind then.
    pub fn save(&self, private: &Path, machine: &str) -> Result<KeyFiles, KeyError> {
        let files = Self::files(private);
        let private_pem = self.pair.sk.to_pem();
        let public_pem = self.pair.pk.to_pem();
        let page = self.identity(machine).to_page();
        let complete = [
            complete(&files.private, 0o600, private_pem.as_bytes())?,
            complete(&files.public, 0o644, public_pem.as_bytes())?,
            complete(&files.page, 0o644, &page)?,
        ];
        publish(complete).map_err(|error| write_error(&error.path, error.source))?;
        Ok(files)
    }
}

impl std::fmt::Debug for SigningKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("SigningKey(..)")
    }
}

/// What a board on this machine is given.
pub fn identity(key: PublicKey, machine: &str) -> Identity {
    Identity {
        key,
        machine: MachineId::of(machine),
    }
}

/// Writes the key page of one more board, with the key of others.
///
/// # Errors
/// `KeyError::Exists`, `KeyError::File`.
pub fn save_page(key: PublicKey, machine: &str, path: &Path) -> Result<(), KeyError> {
    let page = complete(path, 0o644, &identity(key, machine).to_page())?;
    publish([page]).map_err(|error| write_error(&error.path, error.source))
}

/// Reads a public key.
///
/// # Errors
/// `KeyError::File`, `KeyError::Form`.
pub fn read_public(path: &Path) -> Result<PublicKey, KeyError> {
    ed25519_compact::PublicKey::from_pem(&read_text(path)?)
        .ok()
        .and_then(|key| PublicKey::from_bytes(*key))
        .ok_or_else(|| KeyError::Form {
            path: path.into(),
            expected: "Ed25519 public key in PEM",
        })
}

fn read_text(path: &Path) -> Result<String, KeyError> {
    bounded::read_text(path, LARGEST_KEY).map_err(|source| file_error(path, source))
}

fn file_error(path: &Path, source: io::Error) -> KeyError {
    KeyError::File {
        path: path.into(),
        source,
    }
}

/// A new file without a name yet.
fn complete(path: &Path, mode: u32, bytes: &[u8]) -> Result<Complete, KeyError> {
    let write = || {
        let mut file = AtomicFile::create_new(path, mode)?;
        file.write_all(bytes)?;
        file.complete()
    };
    write().map_err(|source| write_error(path, source))
}

fn write_error(path: &Path, source: io::Error) -> KeyError {
    match source.kind() {
        io::ErrorKind::AlreadyExists => KeyError::Exists(path.into()),
        _ => file_error(path, source),
    }
}
