//! The `loadtwin` command: parse, dispatch, exit code.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use clap::Parser;
use loadtwin::cli::Cli;

fn main() -> ExitCode {
    // Clap itself exits with 2 on wrong usage.
    match Cli::parse().run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("loadtwin: {error:#}");
            ExitCode::FAILURE
        }
    }
}
