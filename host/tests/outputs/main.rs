//! Outputs of the real binary: never an input, never another's file, complete or absent.

mod bench;
mod interrupted;
#[cfg(unix)]
mod paths;
mod refused;
mod streams;
