//! `loadtwin identify` as a command: what it writes has values and deviations, is read by the next command, and
//! leaves the input as it is; recordings and machines that show nothing are refused in one line.

use std::path::Path;
use std::process::{Command, Output};

use loadtwin::machine::Machine;
use serde_json::Value;

fn loadtwin(folder: &Path, line: &str) -> Output {
    Command::new(env!("CARGO_BIN_EXE_loadtwin"))
        .args(line.split(' '))
        .current_dir(folder)
        .output()
        .unwrap()
}

/// What `line` prints.
fn printed(folder: &Path, line: &str) -> String {
    let output = loadtwin(folder, line);
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{line}: {error}");
    String::from_utf8(output.stdout).unwrap()
}

/// The one line by which `line` is refused.
fn refused(folder: &Path, line: &str) -> String {
    let output = loadtwin(folder, line);
    assert_eq!(output.status.code(), Some(1), "{line}");
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(error.lines().count(), 1, "{error}");
    error
}

/// A folder with the example's bench at 500 Hz as `bench.toml`, with `changes` of its text as `true.toml`.
fn folder(changes: &[(&str, &str)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/bench/machine.toml");
    let text = std::fs::read_to_string(path).unwrap();
    let mut text = text.replace("rate_hz = 2000", "rate_hz = 500");
    std::fs::write(folder.path().join("bench.toml"), &text).unwrap();
    for (old, new) in changes {
        assert!(text.contains(old), "{old}");
        text = text.replace(old, new);
    }
    std::fs::write(folder.path().join("true.toml"), text).unwrap();
    folder
}

#[test]
fn what_is_written_has_values_and_deviations() {
    let folder = folder(&[
        ("moment_kg_m2 = 2.6", "moment_kg_m2 = 2.8"),
        (
            "stiffness_nm_per_rad = 6.0e4",
            "stiffness_nm_per_rad = 5.4e4",
        ),
    ]);
    let folder = folder.path();
    let described = std::fs::read(folder.join("bench.toml")).unwrap();
    printed(
        folder,
        "simulate true.toml --scenario turbulent --duration-s 40 --seed 4 -o turbulent.parquet",
    );
    let json = "identify bench.toml turbulent.parquet --out identified.toml --json";
    let found: Value = serde_json::from_str(&printed(folder, json)).unwrap();
    assert_eq!(found["machine_out"], "identified.toml");
    assert_eq!(std::fs::read(folder.join("bench.toml")).unwrap(), described);
    let parameter = |quantity: &str, part: &str| {
        let parameters = found["parameters"].as_array().unwrap();
        let is = |p: &&Value| p["quantity"] == quantity && p["part"] == part;
        parameters.iter().find(is).unwrap()
    };
    let written = Machine::load(&folder.join("identified.toml")).unwrap();
    let drivetrain = written.drivetrain.unwrap();
    let (brake, shaft) = (&drivetrain.inertias[1], &drivetrain.shafts[0]);
    for (parameter, value, std, truth) in [
        (
            parameter("inertia", "brake"),
            brake.moment_kg_m2,
            brake.moment_std_kg_m2,
            2.8,
        ),
        (
            parameter("stiffness", "gear"),
            shaft.stiffness_nm_per_rad,
            shaft.stiffness_std_nm_per_rad,
            5.4e4,
        ),
    ] {
        assert_eq!(parameter["accepted"], true, "{parameter}");
        let std = std.unwrap();
        assert!((value / parameter["value"].as_f64().unwrap() - 1.0).abs() < 1e-5);
        assert!((std / parameter["std"].as_f64().unwrap() - 1.0).abs() < 1e-5);
        assert!((value - truth).abs() < 2.0 * std, "{value} {std} {truth}");
    }
    // With the posterior as prior nothing more is found.
    let again = printed(
        folder,
        "identify identified.toml turbulent.parquet -o again.toml",
    );
    assert!(again.contains("the description stays as it is"), "{again}");
    assert!(!folder.join("again.toml").exists());
}

#[test]
fn what_shows_nothing_is_refused() {
    let folder = folder(&[("[[reference]]", "[[auxiliary]]"), ("load = ", "# ")]);
    let folder = folder.path();
    printed(
        folder,
        "simulate bench.toml --scenario constant --duration-s 12 --seed 1 -o constant.parquet",
    );
    let error = refused(folder, "identify bench.toml constant.parquet");
    assert!(
        error.contains("the speed changes by") && error.contains("run-up"),
        "{error}"
    );
    let error = refused(folder, "identify true.toml constant.parquet");
    assert!(
        error.contains("no values of a reference for motor_torque, brake_torque"),
        "{error}"
    );
    let rotor = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/rotor/machine.toml");
    let error = refused(
        folder,
        &format!("identify {} constant.parquet", rotor.display()),
    );
    assert!(error.contains("the machine has no [drivetrain]"), "{error}");
}
