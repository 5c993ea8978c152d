//! Makes unnamed files on Linux (`O_TMPFILE`), and gives such a file its name by a link.

use std::fs::File;
use std::io;
use std::os::fd::AsRawFd;
use std::path::Path;

use rustix::fs::{AtFlags, CWD, Mode, OFlags, linkat, openat};

/// Permissions of a new file, from which the user's umask takes away.
const NEW_FILE: u32 = 0o666;

/// A file without a name in `folder`.
pub(crate) fn unnamed(folder: &Path) -> io::Result<File> {
    let flags = OFlags::TMPFILE | OFlags::RDWR | OFlags::CLOEXEC;
    match openat(CWD, folder, flags, Mode::from_raw_mode(NEW_FILE)) {
        Ok(file) => Ok(file.into()),
        // The file system has no such files: one that loses its name at once.
        Err(rustix::io::Errno::OPNOTSUPP | rustix::io::Errno::ISDIR | rustix::io::Errno::INVAL) => {
            tempfile::tempfile_in(folder)
        }
        Err(error) => Err(error.into()),
    }
}

/// Gives a file without a name the name `path`, which must be free.
pub(crate) fn link(file: &File, path: &Path) -> io::Result<()> {
    let descriptor = format!("/proc/self/fd/{}", file.as_raw_fd());
    let follow = AtFlags::SYMLINK_FOLLOW;
    Ok(linkat(CWD, descriptor.as_str(), CWD, path, follow)?)
}
