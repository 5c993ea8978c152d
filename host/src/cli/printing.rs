//! Prints text on standard output, or on standard error where a file goes to standard output
//! (`print`, `say!`); a closed pipe is ignored, any other write error ends the program. `note`
//! prints on standard error; `shown` gives paths as text for JSON.

use std::fmt::Arguments;
use std::io::{ErrorKind, Write, stderr, stdout};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether text goes to standard error, as an output of the command takes standard output.
static TEXT_TO_STANDARD_ERROR: AtomicBool = AtomicBool::new(false);

/// Whether the reader of standard output has gone.
static READER_GONE: AtomicBool = AtomicBool::new(false);

/// From now on text goes to standard error.
pub(super) fn text_to_standard_error() {
    TEXT_TO_STANDARD_ERROR.store(true, Ordering::Relaxed);
}

/// Prints text; where the reader has gone (`| head`), nothing more is printed
/// and the command goes on to its own end and exit code. Where it cannot be
/// written, as on a full disk, the program ends with 1.
pub(super) fn print(text: Arguments<'_>) {
    if TEXT_TO_STANDARD_ERROR.load(Ordering::Relaxed) {
        note(text);
        return;
    }
    if READER_GONE.load(Ordering::Relaxed) {
        return;
    }
    let mut stdout = stdout().lock();
    let written = stdout.write_fmt(text).and_then(|()| stdout.flush());
    match written {
        Ok(()) => {}
        Err(error) if error.kind() == ErrorKind::BrokenPipe => {
            READER_GONE.store(true, Ordering::Relaxed);
        }
        Err(error) => {
            note(format_args!("loadtwin: standard output: {error}\n"));
            std::process::exit(1);
        }
    }
}

/// Prints text on standard error; where that is closed, the exit code remains.
pub(crate) fn note(text: Arguments<'_>) {
    let _ = stderr().lock().write_fmt(text);
}

/// A path in JSON, whose texts are Unicode: what is not is replaced.
pub(super) fn shown(path: impl AsRef<Path>) -> String {
    path.as_ref().display().to_string()
}

/// The same of several.
pub(super) fn shown_all(paths: &[PathBuf]) -> Vec<String> {
    paths.iter().map(shown).collect()
}

/// `println!` through [`print`].
macro_rules! say {
    () => { $crate::cli::printing::print(format_args!("\n")) };
    ($($text:tt)*) => { $crate::cli::printing::print(format_args!("{}\n", format_args!($($text)*))) };
}
pub(super) use say;
