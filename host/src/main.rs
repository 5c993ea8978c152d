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
            eprintln!("loadtwin: {}", in_one_line(&error));
            ExitCode::FAILURE
        }
    }
}

/// The error and its causes, but for those that its text ends with already.
fn in_one_line(error: &anyhow::Error) -> String {
    let causes = error.chain().map(ToString::to_string);
    causes
        .reduce(|said, cause| {
            if said.ends_with(&cause) {
                said
            } else {
                format!("{said}: {cause}")
            }
        })
        .unwrap_or_default()
}
