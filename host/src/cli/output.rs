//! Printing that ends quietly when nobody reads any more.

use std::fmt::Arguments;
use std::io::{ErrorKind, Write, stdout};

/// Prints a line; where the reader has gone (`| head`), ends the program as
/// any other filter does.
pub(super) fn line(text: Arguments<'_>) {
    if let Err(error) = writeln!(stdout().lock(), "{text}") {
        if error.kind() == ErrorKind::BrokenPipe {
            std::process::exit(0);
        }
        eprintln!("loadtwin: standard output: {error}");
        std::process::exit(1);
    }
}

/// `println!` through [`line`].
macro_rules! say {
    () => { $crate::cli::output::line(format_args!("")) };
    ($($text:tt)*) => { $crate::cli::output::line(format_args!($($text)*)) };
}
pub(super) use say;
