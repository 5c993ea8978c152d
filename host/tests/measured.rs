//! Measured data that does not ship with the project: `LOADTWIN_DATA`, or the
//! folder `shared/data` beside the checkout.

use std::path::{Path, PathBuf};
use std::process::Command;

/// The folder, or none with a line that says so to a person and to `tests/run`.
fn measured(folder: &str) -> Option<PathBuf> {
    let root = std::env::var_os("LOADTWIN_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"),
        PathBuf::from,
    );
    let path = root.join(folder);
    if path.is_dir() {
        return Some(path);
    }
    let line = format!(
        "no {}: set LOADTWIN_DATA as the README says",
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

/// The linear model of the tool drive lacks friction and slack: its error is
/// large, in every file, and this says how large.
#[test]
fn the_tool_drive_is_replayed_and_its_error_is_what_the_model_lacks() {
    let Some(folder) = measured("tool-drive") else {
        return;
    };
    let machine = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/tool-drive/machine.toml");
    // RMS of the reference about its zero [Nm], by numpy.
    for (file, rms, samples) in [
        ("00.TXT", 0.0559, 19_994),
        ("02.TXT", 0.0698, 20_000),
        ("03.TXT", 0.0791, 20_000),
        ("11.TXT", 0.0617, 20_000),
        ("21.TXT", 0.0614, 20_000),
        ("32.TXT", 0.0712, 20_000),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_loadtwin"))
            .args(["replay", "--json"])
            .args([&machine, &folder.join(file)])
            .output()
            .unwrap();
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(json["samples"], samples);
        let rmse = json["loads"]["input"]["rmse"].as_f64().unwrap();
        println!("{file}: {:.1} % of the signal's RMS", 100.0 * rmse / rms);
        assert!((0.6..1.0).contains(&(rmse / rms)), "{file}: {rmse}");
    }
}
