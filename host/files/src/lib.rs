//! Reads and writes the files of the commands: inputs are limited in size; outputs are complete or
//! absent, and none replaces an input or, unless forced, a file of another kind. Also marks
//! generated files to detect edits, and makes the temporary folder of a run.
//!
//! A command declares what it reads and writes in an [`outputs::Outputs`] before
//! it works; each output is an [`atomic_file::AtomicFile`] that gets its name
//! when it is complete.
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::unreachable,
        clippy::todo,
        clippy::unimplemented
    )
)]

pub mod atomic_file;
pub mod bounded;
mod destination;
pub mod file_kind;
pub mod hex;
pub mod mark;
pub mod outputs;
pub mod scratch;
mod system;
