//! The executable `loadtwin`: runs `cli::program` on the arguments and returns its exit code.
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

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(loadtwin::cli::program(std::env::args_os()))
}
