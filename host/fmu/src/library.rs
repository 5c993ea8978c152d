//! Shared library that every FMU carries: search by the caller's path or near the command, and
//! check of its version and of the processor in its ELF header.

use std::path::{Path, PathBuf};

use loadtwin_files::bounded;
use memchr::memmem;
use thiserror::Error;

/// `modelIdentifier`: name of the library in an FMU.
pub(crate) const IDENTIFIER: &str = "loadtwin_fmu";

/// What the library holds, so that another one or one of another version is refused.
pub(crate) const MARK: &str = concat!("loadtwin FMU library ", env!("CARGO_PKG_VERSION"), "\n");

/// Name of the library as it is built.
pub const FILE: &str = "libloadtwin_fmu.so";

/// No library is larger (bytes).
const LARGEST: u64 = 256 << 20;

/// Why there is no library.
#[derive(Debug, Error)]
pub enum LibraryError {
    /// It is not where it is looked for.
    #[error(
        "{FILE}: not found in {}; `cargo build --release` makes it in target/release; copy it beside the \
         command, or give it by --library",
        shown(places)
    )]
    NotFound {
        /// Where it was looked for.
        places: Vec<PathBuf>,
    },
    /// It cannot be read.
    #[error("{}: {reason}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why.
        reason: std::io::Error,
    },
    /// It is no library of this version, or of a platform without FMUs.
    #[error(
        "{}: found {found}, allowed: {FILE} of loadtwin {} for Linux on x86-64 or AArch64",
        path.display(), env!("CARGO_PKG_VERSION")
    )]
    Other {
        /// The file.
        path: PathBuf,
        /// What it is.
        found: &'static str,
    },
}

fn shown(places: &[PathBuf]) -> String {
    let places: Vec<String> = places.iter().map(|p| p.display().to_string()).collect();
    places.join(", ")
}

/// The library.
pub struct Library {
    pub(crate) bytes: Vec<u8>,
    pub(crate) platform: Platform,
}

/// Platforms that a library can be for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Platform {
    X86,
    Arm,
}

impl Library {
    /// The library in `path`, else that beside the command.
    ///
    /// # Errors
    /// [`LibraryError`].
    pub fn find(path: Option<&Path>) -> Result<Self, LibraryError> {
        if let Some(path) = path {
            return Self::read(path);
        }
        let command = std::env::current_exe().unwrap_or_default();
        let folder = command.parent().unwrap_or(Path::new(""));
        // In `deps` is what Cargo built with the command; its copy beside the command may be older.
        let places = [
            folder.join("deps"),
            folder.to_path_buf(),
            folder.join("../lib"),
        ];
        let files = places.iter().map(|place| place.join(FILE));
        match files.into_iter().find(|file| file.is_file()) {
            Some(file) => Self::read(&file),
            None => Err(LibraryError::NotFound {
                places: places.to_vec(),
            }),
        }
    }

    fn read(path: &Path) -> Result<Self, LibraryError> {
        let bytes = bounded::read(path, LARGEST).map_err(|reason| LibraryError::Unreadable {
            path: path.to_owned(),
            reason,
        })?;
        let other = |found| LibraryError::Other {
            path: path.to_owned(),
            found,
        };
        // ELF, 64 bits, little endian; the machine is at 18.
        let platform = match (bytes.get(..6), bytes.get(18..20)) {
            (Some(b"\x7fELF\x02\x01"), Some([62, 0])) => Platform::X86,
            (Some(b"\x7fELF\x02\x01"), Some([183, 0])) => Platform::Arm,
            (Some(b"\x7fELF\x02\x01"), _) => return Err(other("one of another processor")),
            _ => return Err(other("no library")),
        };
        // The command holds the mark as well.
        if is_program(&bytes) {
            return Err(other("a program"));
        }
        if memmem::find(&bytes, MARK.as_bytes()).is_none() {
            return Err(other("another library, or one of another version"));
        }
        Ok(Self { bytes, platform })
    }
}

/// Whether an ELF file names the loader that starts it, as libraries do not: a program header of type
/// `PT_INTERP`.
fn is_program(elf: &[u8]) -> bool {
    /// Type `PT_INTERP` of a program header, little endian.
    const INTERPRETER: &[u8] = &[3, 0, 0, 0];
    let number = |at: usize, length: usize| {
        let bytes = elf.get(at..at.saturating_add(length)).unwrap_or_default();
        (bytes.iter().rev()).fold(0_usize, |number, byte| number << 8 | usize::from(*byte))
    };
    let (first, size, count) = (number(32, 8), number(54, 2), number(56, 2));
    (0..count).any(|k| {
        let at = first.saturating_add(k * size);
        elf.get(at..at.saturating_add(4)) == Some(INTERPRETER)
    })
}
