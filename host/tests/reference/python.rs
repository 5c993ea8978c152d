//! Python with the packages of `tests/requirements.txt` for tests that compare with other
//! libraries: its path, and the output of a script.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

/// That of `LOADTWIN_PYTHON`, or the one that `tests/run` sets up.
pub fn python() -> PathBuf {
    std::env::var_os("LOADTWIN_PYTHON").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../target/venv/bin/python"),
        PathBuf::from,
    )
}

/// Output of `script` in this folder, which must succeed.
pub fn output(script: &str, arguments: &[&OsStr]) -> Vec<u8> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/reference");
    let output = Command::new(python())
        .arg(here.join(script))
        .args(arguments)
        .output()
        .unwrap_or_else(|error| {
            panic!(
                "{}: {error}; tests/run sets it up, or LOADTWIN_PYTHON names a Python with \
                 tests/requirements.txt",
                python().display()
            )
        });
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{script} {arguments:?}: {said}");
    output.stdout
}
