//! A shaft line as a bench has it: torque transducers in the line, speeds in place of encoders, one of two loads
//! measured, no converter described, short files, a bad cell. On the real binary.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

/// Motor, flywheel, long shaft with a transducer, gears with a second one as the reference.
const MACHINE: &str = include_str!("../../examples/thruster-bench/machine.toml");

fn run(arguments: &[&str], folder: &Path) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_loadtwin"));
    command
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap()
}

fn json(arguments: &[&str], folder: &Path) -> Value {
    let output = run(&[&["--json"], arguments].concat(), folder);
    let error = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {error}");
    serde_json::from_slice(&output.stdout).unwrap()
}

fn refused(arguments: &[&str], folder: &Path) -> String {
    let output = run(arguments, folder);
    assert_eq!(output.status.code(), Some(1), "{arguments:?}");
    String::from_utf8(output.stderr).unwrap()
}

/// `MACHINE` with each first text in place of the second, as `name`.
fn described(folder: &Path, name: &str, changes: &[(&str, &str)]) -> PathBuf {
    let mut text = MACHINE.split("\n[recording]").next().unwrap().to_string();
    for (from, to) in changes {
        assert!(text.contains(from), "{from}");
        text = text.replacen(from, to, 1);
    }
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap();
    path
}

fn simulated(folder: &Path, machine: &str, name: &str, more: &[&str]) {
    let fixed = ["simulate", machine, "--seed", "3", "-o", name];
    json(&[&fixed, more].concat(), folder);
}

/// Numbers of a column of a recording that `simulate` wrote.
fn column(folder: &Path, recording: &str, name: &str) -> Vec<f64> {
    let text = std::fs::read_to_string(folder.join(recording)).unwrap();
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let mut header = lines.next().unwrap().split(',');
    let at = header.position(|h| h.starts_with(name)).unwrap();
    let cell = |line: &str| line.split(',').nth(at).unwrap().parse().unwrap();
    lines.map(cell).collect()
}

fn nmae(replayed: &Value) -> f64 {
    let load = &replayed["loads"]["propeller"];
    load["nmae_percent"]["full"].as_f64().unwrap()
}

/// Of two loads one is measured, and nothing but a speed measures the motion: the transducer's gain and zero
/// are found, the noise is tuned, and a healthy bench is distinguished from one whose transducer jumps.
#[test]
fn speeds_take_the_place_of_encoders() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    described(at, "described.toml", &[]);
    let off = "sensitivity = 1.1\noffset = 0.3";
    described(at, "true.toml", &[("sensitivity = 1.0", off)]);
    let ramps = ["--scenario", "torque-ramps", "--duration-s", "20"];
    simulated(at, "true.toml", "ramps.csv", &ramps);
    let fit = [
        "calibrate",
        "described.toml",
        "ramps.csv",
        "-o",
        "calibrated.toml",
    ];
    let calibrated = json(&fit, at);
    let transducer = &calibrated["channels"][0];
    assert_eq!(transducer["name"], "torque_1");
    assert!(
        (transducer["gain"].as_f64().unwrap() - 1.1).abs() < 0.005,
        "{transducer}"
    );
    assert!(
        (transducer["offset"].as_f64().unwrap() - 0.3).abs() < 0.01,
        "{transducer}"
    );
    // The speed that the motion is read from is not fitted to itself.
    assert_eq!(calibrated["channels"].as_array().unwrap().len(), 1);

    let tuned = ["tune", "calibrated.toml", "ramps.csv", "-o", "tuned.toml"];
    json(&tuned, at);
    let error = |machine: &str| nmae(&json(&["replay", machine, "ramps.csv"], at));
    let [before, after, best] = ["described.toml", "calibrated.toml", "tuned.toml"].map(error);
    assert!(
        before > 10.0 && after < 1.0 && best <= after,
        "{before} {after} {best}"
    );

    assert_eq!(
        json(&["diagnose", "calibrated.toml", "ramps.csv"], at)["verdict"],
        "none"
    );
    let jumps = [&ramps[..], &["--effect", "gauge-step@torque_1=1"]].concat();
    simulated(at, "true.toml", "step.csv", &jumps);
    let found = json(&["diagnose", "calibrated.toml", "step.csv"], at);
    assert_eq!(found["effects"][0]["name"], "gauge-step", "{found}");
}

/// Null samples are simulated under the load that is measured, wherever it stands.
#[test]
fn the_order_of_the_loads_does_not_matter() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    described(at, "machine.toml", &[]);
    let (before, motor) = MACHINE
        .split_once("[[drivetrain.load]]\nname = \"motor\"")
        .unwrap();
    let (motor, rest) = motor.split_once("[[drivetrain.load]]\n").unwrap();
    let (propeller, rest) = rest.split_once("[[channel]]").unwrap();
    let other = format!(
        "{before}[[drivetrain.load]]\n{propeller}[[drivetrain.load]]\nname = \"motor\"{motor}[[channel]]{rest}"
    );
    std::fs::write(
        at.join("other.toml"),
        other.split("\n[recording]").next().unwrap(),
    )
    .unwrap();
    let steps = ["--scenario", "torque-ramps", "--duration-s", "20"];
    simulated(at, "machine.toml", "steps.csv", &steps);
    let candidates =
        |machine: &str| json(&["diagnose", machine, "steps.csv"], at)["candidates"].clone();
    assert_eq!(candidates("machine.toml"), candidates("other.toml"));
}

/// Ten seconds are needed, in one recording or in several.
#[test]
fn several_short_recordings_are_diagnosed_together() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    described(at, "machine.toml", &[]);
    let ramps = ["--scenario", "torque-ramps", "--duration-s", "24"];
    simulated(at, "machine.toml", "whole.csv", &ramps);
    let text = std::fs::read_to_string(at.join("whole.csv")).unwrap();
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let header = lines.next().unwrap();
    let rows: Vec<&str> = lines.collect();
    // 2.2 s each.
    let parts: Vec<String> = (rows.chunks_exact(2209).take(6).enumerate())
        .map(|(k, rows)| {
            let name = format!("part-{k}.csv");
            std::fs::write(at.join(&name), format!("{header}\n{}\n", rows.join("\n"))).unwrap();
            name
        })
        .collect();
    let of = |parts: &[String]| -> Vec<String> {
        let fixed = ["diagnose", "machine.toml"].map(String::from);
        fixed.iter().chain(parts).cloned().collect()
    };
    let [few, all] = [of(&parts[..4]), of(&parts)];
    let few: Vec<&str> = few.iter().map(String::as_str).collect();
    let all: Vec<&str> = all.iter().map(String::as_str).collect();
    let error = refused(&few, at);
    assert!(
        error.contains("8.8 s are too short") && error.contains("several"),
        "{error}"
    );
    assert_eq!(json(&all, at)["verdict"], "none");
}

/// The filter takes the zero of a measured drive torque off, as calibration and diagnosis do.
#[test]
fn a_drive_torque_is_read_less_its_zero() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let flywheel = "[[drivetrain.inertia]]\nname = \"flywheel\"\nmoment_kg_m2 = 7.8e-3\n";
    let (_, after) = MACHINE.split_once("[[drivetrain.shaft]]").unwrap();
    let (shafts, _) = after
        .split_once("[[drivetrain.load]]\nname = \"propeller\"")
        .unwrap();
    let shafts = format!("[[drivetrain.shaft]]{shafts}");
    let changes = [
        (
            "[[drivetrain.inertia]]\nname = \"motor\"\nmoment_kg_m2 = 8.0e-4\n",
            "",
        ),
        (flywheel, ""),
        ("speed_ratio = 0.08333333333\n", ""),
        (shafts.as_str(), ""),
        ("{ shaft = \"long shaft\" }", "{ drive = \"gears\" }"),
        ("nominal_speed_rad_s = 210.0", "nominal_speed_rad_s = 17.5"),
    ];
    let zero = (
        "sensitivity = 1.0",
        "sensitivity = 0.0833333333\noffset = 0.5",
    );
    described(at, "zero.toml", &[&changes[..], &[zero]].concat());
    let other = ("sensitivity = 1.0", "sensitivity = 0.075");
    described(at, "other.toml", &[&changes[..], &[other]].concat());
    let ramps = ["--scenario", "torque-ramps", "--duration-s", "30"];
    simulated(at, "zero.toml", "ramps.csv", &ramps);
    let error = |machine: &str| nmae(&json(&["replay", machine, "ramps.csv"], at));
    assert!(error("zero.toml") < 3.0, "{}", error("zero.toml"));
    assert!(error("other.toml") > 15.0);
    let fit = [
        "calibrate",
        "other.toml",
        "ramps.csv",
        "-o",
        "calibrated.toml",
    ];
    let found = json(&fit, at);
    let offset = found["channels"][0]["offset"].as_f64().unwrap();
    assert!((offset - 0.5).abs() < 0.02, "{found}");
    assert!(error("calibrated.toml") < 3.0);
}

/// A tachometer without a sensitivity reads the speed, in whichever unit.
#[test]
fn a_tachometer_reads_revolutions_a_minute() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let own = "sensitivity = 12.0\nnoise_std = 0.3";
    described(at, "rad.toml", &[(own, "noise_std = 0.3")]);
    let changes = [
        (own, "noise_std = 3"),
        ("unit = \"rad/s\"", "unit = \"rpm\""),
    ];
    described(at, "rpm.toml", &changes);
    let mean = |machine: &str| {
        simulated(
            at,
            machine,
            "speed.csv",
            &["--scenario", "constant", "--duration-s", "4", "--force"],
        );
        let speeds = column(at, "speed.csv", "speed_2");
        speeds.iter().sum::<f64>() / speeds.len() as f64
    };
    let (rad, rpm) = (mean("rad.toml"), mean("rpm.toml"));
    assert!(
        (rpm / rad * std::f64::consts::PI / 30.0 - 1.0).abs() < 0.01,
        "{rad} rad/s, {rpm} rpm"
    );
}

/// Readings need no converter; a board does.
#[test]
fn an_image_for_a_board_needs_the_converter() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    described(at, "machine.toml", &[]);
    let error = refused(&["build", "machine.toml", "-o", "machine.image"], at);
    assert!(
        error.contains("torque_1") && error.contains("adc"),
        "{error}"
    );
    assert!(!at.join("machine.image").exists());
}

/// A cell that is no number is named, and is a missing sample where the description says so.
#[test]
fn a_bad_cell_is_missing_where_the_user_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let machine = described(at, "machine.toml", &[]);
    simulated(
        at,
        "machine.toml",
        "good.csv",
        &["--scenario", "constant", "--duration-s", "4"],
    );
    let text = std::fs::read_to_string(at.join("good.csv")).unwrap();
    let rows: Vec<&str> = text.lines().filter(|line| !line.starts_with('#')).collect();
    let header: Vec<&str> = rows[0].split(',').collect();
    let torque = header
        .iter()
        .position(|h| h.starts_with("torque_1"))
        .unwrap();
    let row = |(number, row): (usize, &&str)| {
        let mut cells: Vec<&str> = row.split(',').collect();
        if number == 1500 {
            cells[torque] = "n/a";
        }
        cells.join(",")
    };
    let bad: Vec<String> = rows.iter().enumerate().map(row).collect();
    std::fs::write(at.join("bad.csv"), bad.join("\n")).unwrap();
    let error = refused(&["replay", "machine.toml", "bad.csv"], at);
    for word in ["row 1500", "`torque_1`", "`n/a`", "`missing`"] {
        assert!(error.contains(word), "{word}: {error}");
    }
    let mut text = std::fs::read_to_string(&machine).unwrap();
    text += "\n[recording]\nmissing = [\"n/a\", \"-999\"]\n";
    std::fs::write(machine, text).unwrap();
    let replayed = json(&["replay", "machine.toml", "bad.csv"], at);
    assert_eq!(replayed["flags"]["missing"], 1, "{replayed}");
}
