//! A recording from standard input or another pipe.

use std::fs::File;
use std::io::{self, IsTerminal};
use std::os::fd::AsRawFd;
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};

use anyhow::Context;

/// A recording that can be opened as often as needed.
pub(super) struct Spooled {
    /// Where it is opened.
    pub(super) path: PathBuf,
    /// What came through a pipe; the path leads to it.
    _file: Option<File>,
}

/// The recording in `path`; `-` is standard input. What comes through a pipe is
/// put into a file without a name first: Parquet and MDF4 are not read in order.
///
/// # Errors
/// When it cannot be read.
pub(super) fn spooled(path: &Path) -> anyhow::Result<Spooled> {
    let is_dash = path == Path::new("-");
    anyhow::ensure!(
        !(is_dash && io::stdin().is_terminal()),
        "-: standard input is a terminal; allowed: a file or a pipe"
    );
    let path = if is_dash {
        Path::new("/dev/stdin")
    } else {
        path
    };
    let is_pipe = path.metadata().is_ok_and(|found| {
        let kind = found.file_type();
        kind.is_fifo() || kind.is_socket()
    });
    if !is_pipe {
        return Ok(Spooled {
            path: path.to_path_buf(),
            _file: None,
        });
    }
    let copy = || {
        let mut file = tempfile::tempfile()?;
        io::copy(&mut File::open(path)?, &mut file)?;
        io::Result::Ok(file)
    };
    let file = copy().with_context(|| path.display().to_string())?;
    Ok(Spooled {
        path: format!("/proc/self/fd/{}", file.as_raw_fd()).into(),
        _file: Some(file),
    })
}
