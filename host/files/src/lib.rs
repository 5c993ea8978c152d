//! Output files that are complete or absent.
#![forbid(unsafe_code)]

pub mod atomic_file;
