//! Runs a command line from its arguments to its exit code (`program`, called by `main`): parses,
//! runs the command, and prints its error in one line. 0: done; 1: not done; 2: wrong usage.

use std::ffi::OsString;
use std::io::{self, ErrorKind, Write, stderr};

use super::Cli;

/// Runs the command line `arguments`, the program's name first; its exit code.
pub fn program(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    let cli = match Cli::from_arguments(arguments) {
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
        Ok(()) => 0,
        // The reader of an output, as `| head`, has what it wanted.
        Err(error) if is_closed_pipe(&error) => 0,
        Err(error) => failed(&in_one_line(&error)),
    }
}

fn exit_code(code: i32) -> u8 {
    u8::try_from(code).unwrap_or(1)
}

fn failed(message: &str) -> u8 {
    // Where standard error is closed as well, the exit code remains.
    let _ = writeln!(stderr(), "loadtwin: {message}");
    1
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
