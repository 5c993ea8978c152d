//! Makes a recording from standard input or a pipe readable repeatedly and at any position: copies
//! it to a temporary file (`spooled`). A recording in a file is left where it is.

use std::io::{self, IsTerminal, Read};
use std::path::{Path, PathBuf};

use anyhow::Context;

#[cfg(not(target_os = "linux"))]
use named::Copy;
#[cfg(target_os = "linux")]
use unnamed::Copy;

/// A recording that can be opened as often as needed.
pub(super) struct Spooled {
    /// Where it is opened.
    pub(super) path: PathBuf,
    /// What came through a pipe; the path leads to it.
    _copy: Option<Copy>,
}

/// The recording in `path`; `-` is standard input. What comes through a pipe is
/// put into a file first: Parquet and MDF4 are not read in order.
///
/// # Errors
/// When it cannot be read.
pub(super) fn spooled(path: &Path) -> anyhow::Result<Spooled> {
    let is_dash = path == Path::new("-");
    anyhow::ensure!(
        !(is_dash && io::stdin().is_terminal()),
        "-: standard input is a terminal; allowed: a file or a pipe"
    );
    let plain = |path: &Path| Spooled {
        path: path.to_path_buf(),
        _copy: None,
    };
    let copied = |source: &mut dyn Read| {
        let copy = Copy::of(source)?;
        io::Result::Ok(Spooled {
            path: copy.path(),
            _copy: Some(copy),
        })
    };
    let stdin = Path::new("/dev/stdin");
    let named = if is_dash { stdin } else { path };
    let spooled = match named.metadata() {
        Ok(found) if is_pipe(&found) => {
            std::fs::File::open(named).and_then(|mut pipe| copied(&mut pipe))
        }
        Ok(_) => Ok(plain(named)),
        // A system without names for standard input.
        Err(_) if is_dash => copied(&mut io::stdin().lock()),
        Err(_) => Ok(plain(path)),
    };
    spooled.with_context(|| named.display().to_string())
}

#[cfg(unix)]
fn is_pipe(found: &std::fs::Metadata) -> bool {
    use std::os::unix::fs::FileTypeExt;
    let kind = found.file_type();
    kind.is_fifo() || kind.is_socket()
}

/// Pipes of other systems have no place among the files.
#[cfg(not(unix))]
fn is_pipe(_found: &std::fs::Metadata) -> bool {
    false
}

#[cfg(target_os = "linux")]
mod unnamed {
    use std::fs::File;
    use std::io::{self, Read};
    use std::os::fd::AsRawFd;
    use std::path::PathBuf;

    /// A file without a name: nothing is left of it, however the program ends.
    pub(super) struct Copy(File);

    impl Copy {
        pub(super) fn of(source: &mut dyn Read) -> io::Result<Self> {
            let mut file = tempfile::tempfile()?;
            io::copy(source, &mut file)?;
            Ok(Self(file))
        }

        pub(super) fn path(&self) -> PathBuf {
            format!("/proc/self/fd/{}", self.0.as_raw_fd()).into()
        }
    }
}

#[cfg(not(target_os = "linux"))]
mod named {
    use std::io::{self, Read};
    use std::path::PathBuf;

    /// A temporary file, removed at the end.
    pub(super) struct Copy(tempfile::NamedTempFile);

    impl Copy {
        pub(super) fn of(source: &mut dyn Read) -> io::Result<Self> {
            let mut file = tempfile::NamedTempFile::new()?;
            io::copy(source, &mut file)?;
            Ok(Self(file))
        }

        pub(super) fn path(&self) -> PathBuf {
            self.0.path().to_path_buf()
        }
    }
}
