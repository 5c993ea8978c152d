//! The `loadtwin` command: parse, dispatch, exit code.
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

use std::io::{self, ErrorKind, Write, stderr};
use std::process::ExitCode;

use loadtwin::cli::Cli;

fn main() -> ExitCode {
    let cli = match Cli::from_command_line() {
        Ok(cli) => cli,
        Err(usage) => {
            return match usage.print().and_then(|()| io::stdout().flush()) {
                // 2 on wrong usage, 0 for help and version.
                Ok(()) => exit_code(usage.exit_code()),
                Err(error) if error.kind() == ErrorKind::BrokenPipe => exit_code(usage.exit_code()),
                Err(error) => failed(&format!("standard output: {error}")),
            };
        }
    };
    match cli.run() {
        Ok(()) => ExitCode::SUCCESS,
        // The reader of an output, as `| head`, has what it wanted.
        Err(error) if is_closed_pipe(&error) => ExitCode::SUCCESS,
        Err(error) => failed(&in_one_line(&error)),
    }
}

fn exit_code(code: i32) -> ExitCode {
    u8::try_from(code).map_or(ExitCode::FAILURE, ExitCode::from)
}

fn failed(message: &str) -> ExitCode {
    // Where standard error is closed as well, the exit code remains.
    let _ = writeln!(stderr(), "loadtwin: {message}");
    ExitCode::FAILURE
}

fn is_closed_pipe(error: &anyhow::Error) -> bool {
    error.chain().any(|cause| {
        let mut io = cause.downcast_ref::<io::Error>();
        while let Some(error) = io {
            if error.kind() == ErrorKind::BrokenPipe {
                return true;
            }
            io = error.get_ref().and_then(|inner| inner.downcast_ref());
        }
        false
    })
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
