//! `loadtwin diagnose` of rotors on recordings of an effect that it does not know: rates of the
//! benchmark, gain error, runout, surface lobes, improved description, nothing named for a change
//! of drive.

#[path = "../examples/rotor_benchmark/cases.rs"]
mod cases;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use loadtwin::machine::Machine;
use rayon::prelude::*;
use serde_json::Value;

fn example() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/rotor/machine.toml")
}

/// Seed of the rotors and cases.
const SEED: u64 = 2026;

/// A runout in a run-up, a clean one, and a bow at one speed.
const NUMBERS: [usize; 3] = [1, 7, 11];

#[test]
fn undeclared_effects_of_a_rotor_are_found() {
    let (rotors, cases) = cases::drawn(&Machine::load(&example()).unwrap(), 1, SEED);
    assert!(cases.len() == cases::OF_EACH);
    NUMBERS.into_par_iter().for_each(|number| {
        let case = &cases[number];
        let (right, said) = case.evaluate(&rotors[case.rotor]).unwrap();
        println!("{}: {said}", case.truth());
        assert!(right, "{}: {said}", case.truth());
    });
}

fn loadtwin(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_loadtwin"))
        .args(arguments)
        .output()
        .unwrap()
}

/// The example with an encoder and a range of speeds.
fn with_encoder(folder: &Path) -> String {
    let text = std::fs::read_to_string(example()).unwrap();
    let text = text.replace("rate_hz = 2000", "rate_hz = 1000");
    let text = text.replace(
        "speed_rad_s = 87.96",
        "speed_rad_s = 87.96\nschedule_rad_s = [60, 180]",
    );
    let encoder = "\n[[encoder]]\nname = \"shaft\"\ncounts_per_turn = 4096\nbits = 16\n";
    let path = folder.join("machine.toml");
    std::fs::write(&path, text + encoder).unwrap();
    path.display().to_string()
}

fn recorded(machine: &str, folder: &Path, seed: &str, effects: &[&str]) -> String {
    simulated(machine, folder, "run-up", seed, effects)
}

fn simulated(machine: &str, folder: &Path, scenario: &str, seed: &str, effects: &[&str]) -> String {
    let path = folder.join(format!("{seed}.parquet")).display().to_string();
    let mut arguments = vec!["simulate", machine, "--scenario", scenario, "--seed", seed];
    arguments.extend(["--individual", "1", "--duration-s", "6", "-o", &path]);
    for effect in effects {
        arguments.extend(["--effect", effect]);
    }
    let output = loadtwin(&arguments);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    path
}

/// Diagnosis of `fitted`, with the improved description in `out`.
fn diagnosed(machine: &str, fitted: &[&str], held_out: &str, out: &str) -> Value {
    let mut arguments = vec!["diagnose", "--json", machine];
    arguments.extend(fitted);
    arguments.extend(["--validate", held_out, "--out", out]);
    let page = format!("{out}.html");
    arguments.extend(["--report", &page]);
    let output = loadtwin(&arguments);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    assert!(std::fs::metadata(&page).unwrap().len() > 10_000);
    serde_json::from_slice(&output.stdout).unwrap()
}

/// NMAE of the force at disc 1 along x [%].
fn nmae(machine: &str, recording: &str) -> f64 {
    let output = loadtwin(&["replay", "--json", machine, recording]);
    assert!(output.status.success());
    let said: Value = serde_json::from_slice(&output.stdout).unwrap();
    said["loads"]["disc1_x"]["nmae_percent"]["full"]
        .as_f64()
        .unwrap()
}

/// Named, sized, and taken into a description with which `replay` errs less.
#[test]
fn a_gain_error_of_a_rotor_is_named_and_the_description_is_improved() {
    let folder = tempfile::tempdir().unwrap();
    let machine = with_encoder(folder.path());
    let effects = ["gain-error@x32=1"];
    let fitted = recorded(&machine, folder.path(), "3", &effects);
    let held_out = recorded(&machine, folder.path(), "4", &effects);
    let out = folder.path().join("improved.toml").display().to_string();
    let said = diagnosed(&machine, &[&fitted], &held_out, &out);
    assert_eq!(said["verdict"], "effect", "{said}");
    assert_eq!(said["effects"][0]["name"], "gain-error", "{said}");
    assert_eq!(said["effects"][0]["place"], "x32", "{said}");
    let gain = said["effects"][0]["parameters"]["part of the reading"]
        .as_f64()
        .unwrap();
    assert!((gain - 0.05).abs() < 5e-3, "{gain}");
    let error = |which: &str| {
        said["error"]["nominal"][which]["value_percent"]
            .as_f64()
            .unwrap()
    };
    assert!(error("after") < 0.5 * error("before"), "{said}");
    let (described, improved) = (nmae(&machine, &held_out), nmae(&out, &held_out));
    println!("gain: NMAE of disc1_x {described:.2} % as described, {improved:.2} % as improved");
    assert!(improved < 0.5 * described, "{improved} {described}");
}

/// From two recordings, which differ in their unbalances: what is written subtracts the surface by
/// the angle of the encoder.
#[test]
fn a_runout_that_two_recordings_show_is_subtracted_afterwards() {
    let folder = tempfile::tempdir().unwrap();
    let machine = with_encoder(folder.path());
    let effects = ["runout@32=1"];
    let fitted = ["3", "5"].map(|seed| recorded(&machine, folder.path(), seed, &effects));
    let held_out = recorded(&machine, folder.path(), "4", &effects);
    let out = folder.path().join("improved.toml").display().to_string();
    let said = diagnosed(&machine, &[&fitted[0], &fitted[1]], &held_out, &out);
    let found: Vec<&str> = (said["effects"].as_array().unwrap().iter())
        .map(|effect| effect["name"].as_str().unwrap())
        .collect();
    assert_eq!(found, ["runout", "surface-lobes"], "{said}");
    let improved = Machine::load(Path::new(&out)).unwrap();
    for channel in &improved.channels {
        let size = channel.runout.first().map(|[a, b]| a.hypot(*b));
        if channel.name.ends_with("32") {
            assert!((size.unwrap() - 1e-5).abs() < 5e-7, "{size:?}");
        } else {
            assert_eq!(size, None);
        }
    }
    let (described, improved) = (nmae(&machine, &held_out), nmae(&out, &held_out));
    println!("runout: NMAE of disc1_x {described:.2} % as described, {improved:.2} % as improved");
    assert!(improved < 5e-3 * described, "{improved} {described}");
}

/// At one speed only the waves of the surface that no unbalance makes are observable.
#[test]
fn the_lobes_of_a_surface_are_named_at_one_speed() {
    let folder = tempfile::tempdir().unwrap();
    let machine = with_encoder(folder.path());
    let fitted = simulated(&machine, folder.path(), "constant", "6", &["runout@5=1"]);
    let output = loadtwin(&["diagnose", "--json", &machine, &fitted]);
    let said: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(said["verdict"], "effect", "{said}");
    assert_eq!(said["effects"][0]["name"], "surface-lobes", "{said}");
    assert_eq!(said["effects"][0]["place"], "node 5", "{said}");
    let silent = said["cannot_show"].as_array().unwrap();
    assert!(silent.iter().any(|name| name == "runout"), "{said}");
}

/// A fan that overhangs, run up by a torque that stays along the bearings' axis, which the description
/// does not say: what that adds to the stiffness is no effect.
#[test]
fn how_a_rotor_is_driven_is_no_effect() {
    let folder = tempfile::tempdir().unwrap();
    let described = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/rotor/overhung.toml");
    let text = std::fs::read_to_string(&described).unwrap();
    let real = folder.path().join("real.toml");
    std::fs::write(
        &real,
        text.replace("[rotor]", "[rotor]\nacceleration_stiffness = 1"),
    )
    .unwrap();
    let fitted = simulated(
        &real.display().to_string(),
        folder.path(),
        "run-up",
        "3",
        &[],
    );
    let output = loadtwin(&[
        "diagnose",
        "--json",
        &described.display().to_string(),
        &fitted,
    ]);
    let said: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(said["verdict"], "none", "{said}");
}
