//! Tests of the real binary: figures of a replay, one clear line for bad input, exit codes,
//! schema, image, zeroing of a bridge.

mod bridge;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const MACHINE: &str = include_str!("../data/two_inertias.toml");
const MAP: &str = include_str!("../data/two_inertias_map.csv");

struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        let bench = Self {
            folder: tempfile::tempdir().unwrap(),
        };
        bench.write("machine.toml", MACHINE);
        bench.write("two_inertias_map.csv", MAP);
        bench.write("good.csv", recording(3000));
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn write(&self, name: &str, text: impl AsRef<[u8]>) {
        std::fs::write(self.path(name), text).unwrap();
    }

    fn run(&self, arguments: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_loadtwin"))
            .args(arguments)
            .current_dir(self.folder.path())
            .output()
            .unwrap()
    }

    /// Runs a replay that must fail with exit code 1, one line that holds all
    /// `expected`, and no output left behind.
    fn refused(&self, machine: &str, recording: &str, expected: &[&str]) {
        let arguments = [
            "replay",
            machine,
            recording,
            "--estimates",
            "estimates.csv",
            "--report",
            "report.html",
        ];
        let output = self.run(&arguments);
        let message = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{message}");
        assert_eq!(message.trim_end().lines().count(), 1, "{message}");
        let reason = message.trim_end().rsplit(": ").next().unwrap();
        assert_eq!(message.matches(reason).count(), 1, "said twice: {message}");
        for part in expected {
            assert!(message.contains(part), "no {part:?} in: {message}");
        }
        for name in ["estimates.csv", "report.html"] {
            assert!(
                !self.path(name).exists(),
                "{name} was left behind: {message}"
            );
        }
        let partial = std::fs::read_dir(self.folder.path()).unwrap().flatten();
        let partial: Vec<_> = partial
            .filter(|e| e.file_name().to_string_lossy().contains("partial"))
            .collect();
        assert!(partial.is_empty(), "{partial:?}");
    }

    fn refused_recording(&self, text: impl AsRef<[u8]>, expected: &[&str]) {
        self.write("bad.csv", text);
        self.refused("machine.toml", "bad.csv", expected);
    }

    fn refused_machine(&self, from: &str, to: &str, expected: &[&str]) {
        assert!(MACHINE.contains(from), "{from}");
        self.write("bad.toml", MACHINE.replacen(from, to, 1));
        self.refused("bad.toml", "good.csv", expected);
    }
}

/// `rows` samples of a machine under half its nominal torque, which moves by one count before its index pulse and stands.
fn recording(rows: usize) -> String {
    let mut text =
        "t [s],constant [µm/m],varying [µm/m],encoder [counts],index [counts],torque_main [kNm]\n"
            .to_owned();
    for i in 0..rows {
        let noise = [0.1, -0.2, 0.15, -0.05, 0.0][i % 5];
        let index = if i == 5 { "1" } else { "" };
        let count = u8::from(i >= 3);
        text += &format!(
            "{:.3},{:.3},{:.3},{count},{index},150\n",
            i as f64 / 500.0,
            50.0 + noise,
            63.507 - noise
        );
    }
    text
}

/// The good recording with line `line` (from 1) changed.
fn changed(line: usize, change: impl Fn(&str) -> String) -> String {
    let text = recording(3000);
    let lines = text.lines().enumerate();
    lines.map(|(i, text)| if i + 1 == line { change(text) } else { text.to_owned() } + "\n").collect()
}

#[test]
fn replay_prints_the_same_figures_to_a_person_and_to_a_script() {
    let bench = Bench::new();
    let text = bench.run(&["replay", "machine.toml", "good.csv"]);
    let text = String::from_utf8(text.stdout).unwrap();
    let output = bench.run(&["replay", "machine.toml", "good.csv", "--json"]);
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(json["samples"], 3000);
    let nmae = json["loads"]["main"]["nmae_percent"]["full"]
        .as_f64()
        .unwrap();
    assert!(nmae < 3.0, "{nmae}");
    assert!(text.contains(&format!("{nmae:.2}")), "{text}");
    for key in [
        "machine",
        "recording",
        "rate_hz",
        "filter",
        "samples_per_second",
        "nis_mean",
        "flags",
    ] {
        assert!(!json[key].is_null(), "{key}");
    }
    assert!(json["loads"]["high_speed"]["rmse"].is_null());
}

#[test]
fn estimates_and_report_are_written_whole() {
    let bench = Bench::new();
    for name in ["estimates.csv", "estimates.parquet"] {
        let output = bench.run(&[
            "replay",
            "machine.toml",
            "good.csv",
            "--estimates",
            name,
            "--report",
            "report.html",
        ]);
        assert!(output.status.success());
        assert!(bench.path(name).metadata().unwrap().len() > 10_000);
        assert!(
            std::fs::read_to_string(bench.path("report.html"))
                .unwrap()
                .trim_end()
                .ends_with("</html>")
        );
    }
    let estimates = std::fs::read_to_string(bench.path("estimates.csv")).unwrap();
    let rows = estimates
        .lines()
        .filter(|line| !line.starts_with('#'))
        .count();
    assert_eq!(rows, 3001);
}

#[test]
fn a_recording_that_is_wrong_is_refused_with_its_place() {
    let bench = Bench::new();
    let good = recording(3000);
    bench.refused_recording(good.replace(",varying", ",other"), &["bad.csv", "varying"]);
    bench.refused_recording(
        good.replace("varying [µm/m]", "varying [mm]"),
        &["bad.csv", "varying", "mm"],
    );
    bench.refused_recording(
        good.replace("varying [µm/m]", "constant [µm/m]"),
        &["bad.csv", "constant"],
    );
    bench.refused_recording(
        changed(1002, |line| line.replace("63.", "x3.")),
        &["bad.csv", "1002", "x3."],
    );
    bench.refused_recording(
        changed(1002, |line| {
            line.replace("63.507", "NaN").replace("63.", "NaN#")
        }),
        &["bad.csv", "1002", "NaN"],
    );
    bench.refused_recording(
        changed(1002, |line| format!("0.5{}", &line[5..])),
        &["bad.csv", "1002", "0.5"],
    );
    bench.refused_recording(
        changed(1002, |_| String::new()),
        &["bad.csv", "1003", "gap"],
    );
    bench.refused_recording("", &["bad.csv", "empty"]);
    bench.refused("machine.toml", "no.csv", &["no.csv", "No such file"]);
    bench.refused_recording(&good[..good.len() - 20], &["bad.csv", "3001"]);
}

#[test]
fn random_bytes_are_refused_fast() {
    let bench = Bench::new();
    let mut state = 1_u64;
    let bytes: Vec<u8> = (0..100_000_000 / 8)
        .flat_map(|_| {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state ^ (state >> 29)).to_le_bytes()
        })
        .collect();
    let started = std::time::Instant::now();
    bench.refused_recording(&bytes, &["bad.csv"]);
    assert!(started.elapsed().as_secs() < 20);
    bench.write("bad.toml", &bytes[..1_000_000]);
    bench.refused("bad.toml", "good.csv", &["bad.toml"]);
}

#[test]
fn a_machine_that_is_wrong_is_refused_with_line_field_and_range() {
    let bench = Bench::new();
    bench.refused_machine(
        "moment_kg_m2 = 40.0",
        "moment_kg_m2 = -40.0",
        &["bad.toml:14", "moment_kg_m2", "-40", "> 0"],
    );
    bench.refused_machine(
        "moment_kg_m2 = 40.0",
        "moment_kg_m2 = 1e300",
        &["bad.toml:14", "moment_kg_m2", "1e18"],
    );
    bench.refused_machine(
        "moment_kg_m2 = 40.0",
        "moment = 40.0",
        &["bad.toml:14", "moment"],
    );
    bench.refused_machine(
        "inertia = \"rotor\"",
        "inertia = \"roter\"",
        &["inertia", "roter", "rotor, generator"],
    );
    bench.refused_machine(
        "unit = \"µm/m\"",
        "unit = \"furlong\"",
        &["bad.toml", "furlong"],
    );
    bench.refused_machine(
        "rate_hz = 500.0",
        "rate_hz = 0",
        &["bad.toml:3", "rate_hz", "1 to 20000"],
    );
    bench.refused_machine("rate_hz = 500.0", "rate_hz = 100.0", &["0.002", "0.01"]);
    bench.refused_machine("two_inertias_map.csv", "absent.csv", &["absent.csv"]);
    bench.refused_machine("rate_hz = 500.0", "rate_hz = ", &["bad.toml:3"]);
    bench.refused_machine(
        "rate_hz = 500.0",
        "rate_hz = 500,0",
        &["bad.toml:3", "decimal point"],
    );
    bench.refused_machine(
        "rate_hz = 500.0",
        "rate_hz = \"500 Hz\"",
        &["bad.toml:3", "a number", "without unit"],
    );
    let latin1 = [MACHINE.as_bytes(), b"# gr\xf6sste\n"].concat();
    std::fs::write(bench.path("latin1.toml"), latin1).unwrap();
    bench.refused("latin1.toml", "good.csv", &["0xf6", "UTF-8"]);
    bench.refused_machine(
        "adc = { lsb = 0.001, stuck_after = 8 }",
        "adc = { lsb = 0.001 }\nthermal = { gain_per_k = 0.01 }",
        &[
            "channel[1].thermal",
            "[[auxiliary]] of a temperature with `adc`",
        ],
    );
    bench.refused_machine(
        "adc = { lsb = 0.001, stuck_after = 8 }",
        "adc = { lsb = 0.001 }\nlate_s = -0.01",
        &["channel[1].late_s", "-0.01", "0 to 0.2"],
    );
    // It turns twice as fast, so that a pulse once a turn would not fix the angle of its disc.
    bench.refused_machine(
        "counts_per_turn = 4096",
        "counts_per_turn = 4096\neccentricity = { amplitude_rad = 0.002, ahead_at_rad = 0.0 }",
        &["encoder[1].eccentricity", "speed_ratio 1"],
    );
}

#[test]
fn wrong_usage_is_2_and_impossible_is_1() {
    let bench = Bench::new();
    assert_eq!(bench.run(&["replay"]).status.code(), Some(2));
    assert_eq!(
        bench
            .run(&["replay", "machine.toml", "good.csv", "--filtre", "x"])
            .status
            .code(),
        Some(2)
    );
    let output = bench.run(&["replay", "machine.toml", "good.csv", "--sensors", "none"]);
    assert_eq!(output.status.code(), Some(1));
    bench.refused("machine.toml", "absent.csv", &["absent.csv"]);
    bench.refused("absent.toml", "good.csv", &["absent.toml"]);
}

#[test]
fn help_has_examples_and_the_exit_status() {
    let output = Bench::new().run(&["--quiet", "diagnose", "--help"]);
    let help = String::from_utf8(output.stdout).unwrap();
    for part in ["Examples:", "Exit status:", "Effects:"] {
        assert!(help.contains(part), "no {part} in: {help}");
    }
}

#[test]
fn the_committed_schema_is_that_of_the_code() {
    let output = Bench::new().run(&["schema"]);
    let committed = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/machine.schema.json");
    let committed = std::fs::read_to_string(committed).unwrap();
    let current = String::from_utf8(output.stdout).unwrap();
    assert!(
        committed == current,
        "run: loadtwin schema > docs/machine.schema.json"
    );
}

#[test]
fn an_image_is_built_and_its_size_reported() {
    let bench = Bench::new();
    let output = bench.run(&["build", "machine.toml", "-o", "model.image", "--json"]);
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(
        json["bytes"],
        std::fs::metadata(bench.path("model.image")).unwrap().len()
    );
}

#[test]
fn a_reader_that_leaves_early_is_no_error() {
    use std::io::Read;
    use std::process::Stdio;
    let bench = Bench::new();
    let mut child = Command::new(env!("CARGO_BIN_EXE_loadtwin"))
        .args(["schema"])
        .current_dir(bench.folder.path())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let mut errors = String::new();
    child
        .stderr
        .take()
        .unwrap()
        .read_to_string(&mut errors)
        .unwrap();
    child.wait().unwrap();
    assert_eq!(errors, "");
}

#[test]
fn a_tachometer_and_the_index_pulse_do_without_a_counting_encoder() {
    let bench = Bench::new();
    let counting = MACHINE.find("[[encoder]]").unwrap()..MACHINE.find("[[reference]]").unwrap();
    let tachometer = "
[[channel]]
name = \"tachometer\"
unit = \"rad/s\"
senses = { speed = \"generator\" }
sensitivity = 1.0
noise_std = 0.05
adc = { lsb = 1e-4 }

[index]
name = \"index\"
angle_rad = 1.0
tolerance_rad = 0.02

";
    let mut machine = MACHINE.to_owned();
    machine.replace_range(counting, tachometer);
    bench.write("machine.toml", machine);
    for seed in ["1", "2", "3"] {
        let output = bench.run(&["simulate", "machine.toml", "--seed", seed, "-o", "run.csv"]);
        assert!(
            output.status.success(),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        let output = bench.run(&["replay", "machine.toml", "run.csv", "--json"]);
        let json: serde_json::Value = serde_json::from_slice(&output.stdout)
            .unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&output.stderr)));
        let nmae = json["loads"]["main"]["nmae_percent"]["full"]
            .as_f64()
            .unwrap();
        assert!(nmae < 3.0, "{nmae}");
        // Not homed in the first turn only, which takes some seconds.
        let not_homed = json["flags"]["not_homed"].as_u64().unwrap_or(0);
        assert!((1..15_000).contains(&not_homed), "{not_homed}");
    }
}
