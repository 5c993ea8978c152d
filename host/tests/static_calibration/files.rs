//! The command on tables and recordings.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use super::bridge::{Bridge, MACHINE};
use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use serde_json::Value;

pub struct Folder(tempfile::TempDir);

impl Folder {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn write(&self, name: &str, text: &str) -> PathBuf {
        std::fs::write(self.path(name), text).unwrap();
        self.path(name)
    }

    /// Calibrates `files` with the applied load in `motor_flange`.
    pub fn run(&self, files: &[&Path], options: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_loadtwin"))
            .args(["calibrate", MACHINE])
            .args(files)
            .args(["--static", "motor_flange"])
            .args(options)
            .current_dir(self.0.path())
            .output()
            .unwrap()
    }

    pub fn json(&self, files: &[&Path], options: &[&str]) -> Value {
        let output = self.run(files, &[options, &["--json"]].concat());
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        serde_json::from_slice(&output.stdout).unwrap()
    }

    /// The one line of a refusal; nothing is written.
    pub fn refusal(&self, table: &str) -> String {
        let path = self.write("table.csv", table);
        let output = self.run(&[&path], &["-o", "out.toml"]);
        assert_eq!(output.status.code(), Some(1), "{table}");
        assert!(!self.path("out.toml").exists());
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(said.lines().count(), 1, "{said}");
        said
    }
}

pub fn term<'a>(channel: &'a Value, name: &str) -> Option<&'a Value> {
    channel["found"]
        .as_array()
        .unwrap()
        .iter()
        .find(|found| found["term"] == name)
}

#[test]
fn a_table_gives_certificate_and_description() {
    let folder = Folder::new();
    let faulty = Bridge {
        cubic: 0.05,
        hysteresis: 0.1,
        ..Bridge::CLEAN
    };
    let table = folder.write("table.csv", &faulty.table(1));
    let said = folder.json(&[&table], &["-o", "out.toml"]);
    let channel = &said["channels"][0];
    assert_eq!(channel["name"], "left_upper");
    assert_eq!(channel["runs"], 3);
    let percent = term(channel, "hysteresis").unwrap()["percent"]
        .as_f64()
        .unwrap();
    assert!((percent / 0.1 - 1.0).abs() < 0.2, "{percent}");
    // What is written is read by the estimator, and reproduces the table.
    let machine = loadtwin::machine::Machine::load(&folder.path("out.toml")).unwrap();
    let written = machine
        .channels
        .iter()
        .find(|c| c.name == "left_upper")
        .unwrap();
    let sensitivity = written.sensitivity.unwrap();
    assert!((sensitivity / 0.61 - 1.0).abs() < 0.01, "{sensitivity}");
    assert!(written.nonlinearity > 0.0);
    let hysteresis = written.hysteresis.unwrap();
    let mut walk = hysteresis.walk();
    let mut worst: f64 = 0.0;
    for _ in 0..3 {
        let mut before = 0.0;
        for (load, reading) in faulty.loads().iter().zip(&faulty.readings(1)[1]) {
            // The walk of the estimator takes small steps.
            let mut z = 0.0;
            for k in 1..=100 {
                z = walk(before + (load - before) * f64::from(k) / 100.0);
            }
            before = *load;
            let s = 500.0 * load;
            let model = written.offset + sensitivity * written.bent(s, 500.0) + z;
            worst = worst.max((model - 305.0 * reading).abs());
        }
    }
    // Zero and gain of a run are off by 0.02 and 0.005 % at one standard deviation.
    assert!(worst < 0.1e-2 * 305.0, "{worst}");
    // The user's description is not replaced, an edited output neither.
    std::fs::write(folder.path("out.toml"), "mine").unwrap();
    let again = folder.run(&[&table], &["-o", "out.toml"]);
    assert_eq!(again.status.code(), Some(1));
    assert_eq!(
        std::fs::read_to_string(folder.path("out.toml")).unwrap(),
        "mine"
    );
}

/// Six loads up and down of 20 s each, ramps of 2 s, readings and reference with noise, creep of 0.2 %
/// with 10 s.
#[test]
fn a_recording_has_plateaus_and_creep() {
    let folder = Folder::new();
    let record = |creep: f64, seed: u64| {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
        let mut text = "t [s],motor_flange [Nm],left_upper [µm/m]\n".to_owned();
        let levels: Vec<f64> = [0, 1, 2, 3, 4, 5, 4, 3, 2, 1, 0]
            .map(|k| 100.0 * f64::from(k))
            .to_vec();
        let (mut z, dt) = (0.0, 0.01);
        let mut t = 0.0;
        for (k, level) in levels.iter().enumerate() {
            let before = levels[k.saturating_sub(1)];
            for i in 0..2200 {
                let load = before + (level - before) * (f64::from(i) / 200.0).min(1.0);
                z += dt / 10.0 * (load - z);
                let noise: [f64; 2] = [rng.sample(StandardNormal), rng.sample(StandardNormal)];
                let reading = 12.0 + 0.61 * (load + creep * z) + 0.05 * noise[0];
                text += &format!("{t:.2},{:.4},{reading:.5}\n", load + 0.05 * noise[1]);
                t += dt;
            }
        }
        folder.write("recording.csv", &text)
    };
    for seed in 0..5 {
        let said = folder.json(&[&record(0.002, seed)], &[]);
        let channel = &said["channels"][0];
        assert_eq!(channel["loads"], 11);
        let creep = term(channel, "creep").unwrap_or_else(|| panic!("{channel}"));
        let percent = creep["percent"].as_f64().unwrap();
        assert!((percent / 0.2 - 1.0).abs() < 0.2, "{percent}");
        let time = creep["parameter"]["value"].as_f64().unwrap();
        assert!((5.0..20.0).contains(&time), "{time}");
        let sensitivity = channel["sensitivity"]["value"].as_f64().unwrap();
        assert!((sensitivity / 0.6112 - 1.0).abs() < 1e-3, "{sensitivity}");
        let said = folder.json(&[&record(0.0, seed)], &[]);
        assert_eq!(
            said["channels"][0]["found"],
            Value::Array(Vec::new()),
            "{said}"
        );
    }
}

/// Rows of means at several speeds: a part in proportion to speed is separated from the load.
#[test]
fn means_at_speeds_have_a_term_of_speed() {
    let folder = Folder::new();
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
    let mut text = "speed [rpm],motor_flange [Nm],left_upper [µm/m]\n".to_owned();
    for rpm in [0, 100, 200, 300] {
        for load in [50, 150, 250, 350, 450] {
            let noise: f64 = rng.sample(StandardNormal);
            let reading = 3.0 + 0.61 * f64::from(load) + 0.01 * f64::from(rpm) + 0.05 * noise;
            text += &format!("{rpm},{load},{reading:.4}\n");
        }
    }
    let said = folder.json(&[&folder.write("means.csv", &text)], &[]);
    let channel = &said["channels"][0];
    // 3 µm/m at 300 rpm, of 274.5 at 450 Nm.
    let percent = term(channel, "speed").unwrap()["percent"].as_f64().unwrap();
    assert!((percent / 1.093 - 1.0).abs() < 0.05, "{percent}");
    assert_eq!(channel["found"].as_array().unwrap().len(), 1, "{channel}");
}

#[test]
fn loads_that_only_rise_state_no_hysteresis() {
    let folder = Folder::new();
    let mut text = "motor_flange [Nm],left_upper [µm/m]\n".to_owned();
    for k in 0..8 {
        let reading = 30.5 * f64::from(k) + 0.01 * f64::from(k % 3);
        text += &format!("{},{reading}\n", 50 * k);
    }
    let table = folder.write("up.csv", &text);
    let said = folder.json(&[&table], &[]);
    let channel = &said["channels"][0];
    assert!(
        channel["absent"]["hysteresis"]["not_stated"].is_string(),
        "{channel}"
    );
    assert!(channel["certificate_percent"]["reversibility"].is_null());
    let text = String::from_utf8(folder.run(&[&table], &[]).stdout).unwrap();
    assert!(
        text.contains("not stated: loads up and down show it"),
        "{text}"
    );
}

#[test]
fn bad_tables_are_refused_in_one_line() {
    let folder = Folder::new();
    let refused = |table: &str, parts: &[&str]| {
        let said = folder.refusal(table);
        for part in parts.iter().chain(&["table.csv"]) {
            assert!(said.contains(part), "{said}");
        }
    };
    let header = "motor_flange [Nm],left_upper [µm/m]\n";
    refused(
        "motor_flange,left_upper [µm/m]\n0,0\n100,61\n0,0\n",
        &["motor_flange", "unit", "Nm"],
    );
    refused(
        "motor_flange [kg],left_upper [µm/m]\n0,0\n100,61\n0,0\n",
        &["kg", "Nm"],
    );
    refused(
        &format!("{header}100,61\n100,61.1\n100,61\n"),
        &["one load", "100 Nm", "two or more"],
    );
    refused(
        &format!("{header}0,0\n100,sixty\n200,122\n"),
        &["line 3", "sixty"],
    );
    refused(
        "motor_flange [Nm],motor_flange [Nm],left_upper [µm/m]\n0,0,0\n100,100,61\n",
        &["motor_flange", "twice"],
    );
    refused(
        "motor_flange [Nm],other [µm/m]\n0,0\n100,61\n",
        &["allowed", "left_upper"],
    );
    refused(
        &format!("{header}0,0\n100,61\n"),
        &["left_upper", "2 loads for 2 parameters"],
    );
    refused(
        "brake_flange [Nm],left_upper [µm/m]\n0,0\n100,61\n",
        &["motor_flange"],
    );
    refused(
        &format!("{header}0,5\n100,5.1\n200,4.9\n100,5.1\n0,5\n"),
        &["left_upper", "output", "0 within"],
    );
    let mut ramp = "t [s],motor_flange [Nm],left_upper [µm/m]\n".to_owned();
    for i in 0..2000 {
        let load = 250.0 * (f64::from(i) / 200.0).sin();
        ramp += &format!("{},{load},{}\n", 0.01 * f64::from(i), 0.6 * load);
    }
    refused(&ramp, &["motor_flange", "held nowhere", "0.8 s"]);
    let output = Command::new(env!("CARGO_BIN_EXE_loadtwin"))
        .args(["calibrate", MACHINE, "table.csv", "--static", "flange"])
        .current_dir(folder.0.path())
        .output()
        .unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(
        said.contains("\"flange\"") && said.contains("motor_flange, brake_flange"),
        "{said}"
    );
}
