//! File functions that differ between systems, in two pairs of modules. Linux or not: unnamed files
//! and their link. Unix or not: write permission, owner, identity of files, standard streams.

#[cfg(unix)]
mod unix;
#[cfg(windows)]
mod windows;

#[cfg(unix)]
pub(crate) use unix::{FileId, Owner, check_writable, stdin_file, stdout_file};
#[cfg(windows)]
pub(crate) use windows::{FileId, Owner, check_writable, stdin_file, stdout_file};

#[cfg(target_os = "linux")]
mod linux;
#[cfg(target_os = "linux")]
pub(crate) use linux::{link, unnamed};

#[cfg(not(target_os = "linux"))]
mod not_linux;
#[cfg(not(target_os = "linux"))]
pub(crate) use not_linux::{link, unnamed};
