//! Replay and diagnosis of measured drives: what each lacks is named, and its error on recordings
//! that took no part is below a bound. The data does not ship with the project: `LOADTWIN_DATA`, or
//! the folder `shared/data` beside the checkout.

mod measured_data;

use std::path::{Path, PathBuf};
use std::process::Command;

use measured_data::measured;

/// Each error of a measured drive in docs/reference/accuracy.md is that of the laboratory notes.
#[test]
fn the_accuracy_page_states_the_figures_of_the_laboratory_notes() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let read = |path: &str| std::fs::read_to_string(root.join(path)).unwrap();
    let (page, notes) = (
        read("docs/reference/accuracy.md"),
        read("docs/lab/results.md"),
    );
    let figure = |row: &str| -> Option<String> {
        let cell = row.split('|').find(|cell| cell.contains("** ("))?;
        Some(cell.trim().to_string())
    };
    let stated: Vec<String> = page.lines().filter_map(figure).collect();
    assert_eq!(stated.len(), 6, "{stated:#?}");
    for figure in stated {
        assert!(notes.contains(&format!("| {figure} |")), "{figure}");
    }
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

/// Torque behind the gears of a thruster bench from a transducer before them and a speed, at each stage of the loop;
/// all is fitted on `step`. NMAE [% of 20 Nm], at most: step, impulse, ice, sine of 32 Hz.
const SHAFT_LINE: [(&str, [f64; 4]); 4] = [
    ("described", [57.0, 60.0, 59.0, 80.0]),
    ("calibrated", [3.3, 4.8, 6.1, 35.0]),
    ("tuned", [2.8, 4.4, 4.6, 32.0]),
    ("diagnosed", [2.8, 4.4, 4.6, 32.0]),
];

/// Each stage of the loop makes each recording better, or leaves it as it is.
#[test]
fn a_shaft_line_gets_better_at_each_stage_of_the_loop() {
    let Some(folder) = measured("thruster-bench") else {
        return;
    };
    let scratch = tempfile::tempdir().unwrap();
    let file = |stage: &str| scratch.path().join(format!("{stage}.toml"));
    let recording = |name: &str| folder.join(format!("{name}_sensor.csv"));
    let run = |arguments: &[&std::ffi::OsStr]| {
        let output = Command::new(env!("CARGO_BIN_EXE_loadtwin"))
            .arg("--json")
            .args(arguments)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{said}");
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()
    };
    let example =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/thruster-bench/machine.toml");
    std::fs::copy(example, file("described")).unwrap();
    let step = recording("step");
    for (command, from, to) in [
        ("calibrate", "described", "calibrated"),
        ("tune", "calibrated", "tuned"),
        ("diagnose", "tuned", "diagnosed"),
    ] {
        let (from, to) = (file(from), file(to));
        let mut arguments = vec![command.as_ref(), from.as_os_str(), step.as_os_str()];
        arguments.extend(["-o".as_ref(), to.as_os_str()]);
        run(&arguments);
        if !to.exists() {
            // Nothing was found that an output could have.
            std::fs::copy(from, to).unwrap();
        }
    }
    let mut before = [f64::INFINITY; 4];
    for (stage, most) in SHAFT_LINE {
        let names = ["step", "impulse", "ice_2000", "sin"];
        let errors = names.map(|name| {
            let replay = run(&[
                "replay".as_ref(),
                file(stage).as_ref(),
                recording(name).as_ref(),
            ]);
            let error = &replay["loads"]["propeller"]["nmae_percent"]["full"];
            error.as_f64().unwrap()
        });
        println!("thruster bench, {stage}: {names:?} {errors:.2?} % of nominal");
        for k in 0..4 {
            assert!(errors[k] < most[k], "{stage}, {}: {}", names[k], errors[k]);
            assert!(
                errors[k] < before[k] + 0.05,
                "{stage}, {}: {}",
                names[k],
                errors[k]
            );
        }
        before = errors;
    }
}

/// A drive that was measured, and what its recordings have to show.
struct Drive {
    /// Folder of the data.
    folder: &'static str,
    /// Description in `examples`.
    machine: &'static str,
    fit: &'static [&'static str],
    /// Recordings that take no part in the fit; empty for a third of the fitted one.
    validate: &'static [&'static str],
    /// The effects of which one has to be named.
    lacks: &'static [&'static str],
    /// Least error without effects, linear part fitted [% of the drive's RMS].
    before: f64,
    /// Greatest error with them.
    after: f64,
    /// Greatest error of the estimator with the written description, sample by sample [% of the
    /// drive's RMS].
    filter: f64,
}

const DRIVES: [Drive; 6] = [
    Drive {
        folder: "tool-drive",
        machine: "tool-drive/balance.toml",
        fit: &["00.TXT", "03.TXT", "32.TXT"],
        validate: &["02.TXT", "11.TXT", "21.TXT"],
        lacks: &["presliding-hysteresis"],
        before: 40.0,
        after: 12.0,
        filter: 12.0,
    },
    Drive {
        folder: "tool-drive",
        machine: "tool-drive/balance.toml",
        fit: &["02.TXT", "11.TXT", "21.TXT"],
        validate: &["00.TXT", "03.TXT", "32.TXT"],
        lacks: &["presliding-hysteresis"],
        before: 40.0,
        after: 12.0,
        filter: 13.0,
    },
    Drive {
        folder: "positioning-axis",
        machine: "positioning-axis/machine.toml",
        fit: &["axis-tracking.csv"],
        validate: &[],
        lacks: &["coulomb-friction"],
        before: 15.0,
        after: 3.0,
        filter: 4.0,
    },
    Drive {
        folder: "direct-drive-motor",
        machine: "direct-drive-motor/slow-turn.toml",
        fit: &["slow-turn-1.csv"],
        validate: &["slow-turn-0.csv", "slow-turn-2.csv"],
        lacks: &["torque-ripple"],
        before: 80.0,
        after: 18.0,
        filter: 18.0,
    },
    Drive {
        folder: "direct-drive-motor",
        machine: "direct-drive-motor/hold.toml",
        fit: &["hold-current-map-a_16.csv"],
        validate: &["hold-current-map-b_16.csv"],
        lacks: &["torque-ripple"],
        before: 90.0,
        after: 10.0,
        filter: 10.0,
    },
    Drive {
        folder: "lead-screw-drive/steady_state/0.096kg",
        machine: "lead-screw-drive/machine.toml",
        fit: &[
            "2.csv", "20.csv", "40.csv", "60.csv", "80.csv", "100.csv", "140.csv", "180.csv",
            "n2.csv", "n20.csv", "n40.csv", "n60.csv", "n80.csv", "n100.csv", "n140.csv",
            "n180.csv",
        ],
        validate: &[
            "10.csv", "30.csv", "50.csv", "70.csv", "90.csv", "120.csv", "160.csv", "200.csv",
            "n10.csv", "n30.csv", "n50.csv", "n70.csv", "n90.csv", "n120.csv", "n160.csv",
            "n200.csv",
        ],
        lacks: &["coulomb-friction", "stribeck-friction"],
        before: 40.0,
        after: 3.0,
        filter: 4.0,
    },
];

/// The diagnosis names what a drive lacks, and its error on recordings that took
/// no part in the fit is as low as docs/lab/results.md says.
#[test]
fn what_measured_drives_lack_is_found() {
    for drive in &DRIVES {
        let Some(folder) = measured(drive.folder) else {
            continue;
        };
        let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples");
        let files = |names: &[&str]| names.iter().map(|n| folder.join(n)).collect::<Vec<_>>();
        let scratch = tempfile::tempdir().unwrap();
        let written = scratch.path().join("found.toml");
        let mut command = Command::new(env!("CARGO_BIN_EXE_loadtwin"));
        command
            .args(["diagnose", "--json", "-o"])
            .arg(&written)
            .arg(examples.join(drive.machine))
            .args(files(drive.fit));
        if !drive.validate.is_empty() {
            command.arg("--validate").args(files(drive.validate));
        }
        let output = command.output().unwrap();
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let effects: Vec<&str> = json["effects"]
            .as_array()
            .unwrap()
            .iter()
            .map(|e| e["name"].as_str().unwrap())
            .collect();
        let percent = |model: &str, when: &str| {
            json["error"][model][when]["value_percent"]
                .as_f64()
                .unwrap()
        };
        let (described, before) = (
            percent("nominal", "before"),
            percent("recalibrated", "before"),
        );
        let after = percent("recalibrated", "after");
        let interval = &json["error"]["recalibrated"]["after"]["interval_percent"];
        println!(
            "{} {:?}: {described:.1} % as described, {before:.1} % linear, {after:.1} % {interval} with {effects:?}",
            drive.machine, drive.fit
        );
        assert!(
            effects.iter().any(|e| drive.lacks.contains(e)),
            "{}: {effects:?}",
            drive.machine
        );
        assert!(before > drive.before, "{}: {before}", drive.machine);
        assert!(after < drive.after, "{}: {after}", drive.machine);
        let filter = filter_error(drive, &written, &files(drive.fit), &files(drive.validate));
        println!("{}: {filter:.1} % by the estimator", drive.machine);
        assert!(filter < drive.filter, "{}: {filter}", drive.machine);
    }
}

/// Error of the estimator on the recordings that were not fitted [% of the drive's RMS]: of a drive
/// that is estimated that against its column, else the load that is estimated where none acts; at
/// steady speeds its mean. Where a third of the fitted recording is held out, of that third.
fn filter_error(drive: &Drive, machine: &Path, fit: &[PathBuf], validate: &[PathBuf]) -> f64 {
    let (mut errors, mut sizes) = (0.0, 0.0);
    let text = std::fs::read_to_string(machine).unwrap();
    let line = text
        .lines()
        .find_map(|line| line.strip_prefix("nominal = "));
    let nominal: f64 = line.unwrap().parse().unwrap();
    for file in if validate.is_empty() { fit } else { validate } {
        let estimates = machine.with_extension("csv");
        let _ = std::fs::remove_file(&estimates);
        let output = Command::new(env!("CARGO_BIN_EXE_loadtwin"))
            .args(["replay", "--json"])
            .args([machine, file])
            .arg("--estimates")
            .arg(&estimates)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{}: {said}", file.display());
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        let load = json["loads"].as_object().unwrap().values().next().unwrap();
        let number = |key: &str| load[key].as_f64();
        let (error, size) = match number("rmse") {
            Some(rmse) => (rmse, number("rms").unwrap()),
            None if drive.machine.starts_with("lead-screw") => (number("mean").unwrap(), nominal),
            None if validate.is_empty() => (last_third(&estimates), nominal),
            None => (number("rms").unwrap(), nominal),
        };
        errors += error * error;
        sizes += size * size;
    }
    100.0 * f64::sqrt(errors / sizes)
}

/// RMS of the load in the last third of a table of estimates.
fn last_third(estimates: &Path) -> f64 {
    let text = std::fs::read_to_string(estimates).unwrap();
    let loads: Vec<f64> = (text.lines().skip(1))
        .map(|line| line.split(',').nth(1).unwrap().parse().unwrap())
        .collect();
    let last = &loads[loads.len() * 2 / 3..];
    (last.iter().map(|x| x * x).sum::<f64>() / last.len() as f64).sqrt()
}
