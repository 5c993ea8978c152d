//! Finds the measured data, which does not ship with the project: in the folder that `LOADTWIN_DATA`
//! names, else in `shared/data` beside the checkout. Where it is absent, the test is reported as skipped.

use std::path::{Path, PathBuf};

/// The folder, or none with a line that says so to a person and to `tests/run`.
pub fn measured(folder: &str) -> Option<PathBuf> {
    let root = std::env::var_os("LOADTWIN_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"),
        PathBuf::from,
    );
    let path = root.join(folder);
    if path.is_dir() {
        return Some(path);
    }
    let line = format!(
        "no {}: set LOADTWIN_DATA as docs/reference/accuracy.md says",
        path.display()
    );
    eprintln!("skipped: {line}");
    if let Some(list) = std::env::var_os("LOADTWIN_SKIPPED") {
        use std::io::Write;
        let mut list = std::fs::File::options()
            .append(true)
            .create(true)
            .open(list)
            .unwrap();
        writeln!(list, "{line}").unwrap();
    }
    None
}
