//! The `loadtwin` command.
#![forbid(unsafe_code)]

fn main() {}
