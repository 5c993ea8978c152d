//! Identifies files on Unix by device and inode, sets owner and permissions of new files, checks
//! write access, and gives the standard streams as files.

use std::fs::{File, Metadata, Permissions};
use std::io;
use std::os::fd::AsFd;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt, fchown};
use std::path::Path;

use rustix::fs::{Access, access};

/// The file that a path refers to, whatever it is called: device and inode.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct FileId(u64, u64);

impl FileId {
    /// Of what `metadata` is of.
    pub(crate) fn of(_path: &Path, metadata: &Metadata) -> Self {
        Self(metadata.dev(), metadata.ino())
    }
}

/// Owner and permissions of a file.
#[derive(Debug)]
pub(crate) struct Owner;

impl Owner {
    /// Gives `file` those of a file that it replaces.
    pub(crate) fn keep(file: &File, replaced: &Metadata) -> io::Result<()> {
        let now = file.metadata()?;
        if (now.uid(), now.gid()) != (replaced.uid(), replaced.gid()) {
            // Only root may give a file away; for others it stays theirs.
            let _ = fchown(file, Some(replaced.uid()), Some(replaced.gid()));
        }
        let mode = replaced.permissions().mode() & 0o777;
        file.set_permissions(Permissions::from_mode(mode))
    }

    /// Takes away the permissions that are not in `mode`.
    pub(crate) fn limit(file: &File, mode: u32) -> io::Result<()> {
        let now = file.metadata()?.permissions().mode();
        file.set_permissions(Permissions::from_mode(now & mode))
    }

    /// A new file at `path` with the permissions of `file`.
    pub(crate) fn new_like(file: &File, path: &Path) -> io::Result<File> {
        let mode = file.metadata()?.permissions().mode() & 0o777;
        File::options()
            .write(true)
            .create_new(true)
            .mode(mode)
            .open(path)
    }
}

/// Whether `path` may be written, or files be made in it.
pub(crate) fn check_writable(path: &Path, is_folder: bool) -> io::Result<()> {
    let how = if is_folder {
        Access::WRITE_OK | Access::EXEC_OK
    } else {
        Access::WRITE_OK
    };
    access(path, how).map_err(io::Error::from)
}

pub(crate) fn stdout_file() -> io::Result<File> {
    Ok(io::stdout().as_fd().try_clone_to_owned()?.into())
}

pub(crate) fn stdin_file() -> io::Result<File> {
    Ok(io::stdin().as_fd().try_clone_to_owned()?.into())
}
