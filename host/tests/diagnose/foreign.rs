//! `loadtwin calibrate` and `diagnose` on recordings of a simulated bench that shares no code with
//! the project, with heavy-tailed noise: the injected effect is named.

use std::path::Path;
use std::process::Command;

/// One bench of `tests/foreign`: what is named without an effect, and that its noise is no fault of a converter.
#[test]
fn a_bench_of_another_make_is_diagnosed() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/foreign");
    let output = Command::new("python3")
        .arg(folder.join("benchmark.py"))
        .args([env!("CARGO_BIN_EXE_loadtwin"), "1", "7"])
        .output()
        .expect("python3 of tests/requirements.txt");
    let said = String::from_utf8_lossy(&output.stdout);
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}{error}");
    let lines: Vec<&str> = said.lines().collect();
    assert_eq!(lines[0], "0 none -> none ", "{said}");
    assert!(
        lines[1].starts_with("0 backlash -> ") && lines[1].contains(" backlash"),
        "{said}"
    );
    assert!(
        lines[2].starts_with("0 late -> effect channel-delay"),
        "{said}"
    );
    assert!(lines[3].starts_with("0 bursts -> unknown"), "{said}");
    assert!(!said.contains("dropped-bits"), "{said}");
    // Both loads with both sets: the stated standard deviation holds the error.
    let band = said
        .lines()
        .find(|line| line.starts_with("two-sigma band of"));
    assert!(
        band.is_some_and(|line| line.contains("  4 of   4")),
        "{said}"
    );
}
