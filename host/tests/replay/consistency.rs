//! Consistency check of `loadtwin replay`: the likely cause where description and recording
//! disagree, on the real binary.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

struct Bench {
    folder: tempfile::TempDir,
}

fn example(name: &str) -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../examples")).join(name)
}

fn loadtwin(arguments: &[&str]) -> Vec<u8> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_loadtwin"));
    let output = command.args(arguments).output().unwrap();
    let reason = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {reason}");
    output.stdout
}

/// Comments, header and rows of a recording.
#[derive(Clone)]
struct Columns {
    comments: Vec<String>,
    head: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Columns {
    fn place(&self, name: &str) -> usize {
        let is = |head: &String| head.split(' ').next() == Some(name);
        self.head.iter().position(is).unwrap()
    }

    /// With `of` of each value of the columns `names`.
    fn with(&self, names: &[&str], of: impl Fn(f64) -> String) -> Self {
        let mut changed = self.clone();
        for name in names {
            let at = self.place(name);
            for row in &mut changed.rows {
                if let Ok(value) = row[at].parse() {
                    row[at] = of(value);
                }
            }
        }
        changed
    }

    fn swapped(&self, a: &str, b: &str) -> Self {
        let (a, b) = (self.place(a), self.place(b));
        let mut changed = self.clone();
        changed.rows.iter_mut().for_each(|row| row.swap(a, b));
        changed
    }
}

impl Bench {
    fn new() -> Self {
        Self {
            folder: tempfile::tempdir().unwrap(),
        }
    }

    fn path(&self, name: &str) -> String {
        self.folder.path().join(name).display().to_string()
    }

    fn simulated(&self, machine: &str, scenario: &str, seconds: &str) -> Columns {
        self.simulated_as(machine, scenario, seconds, &[])
    }

    fn simulated_as(
        &self,
        machine: &str,
        scenario: &str,
        seconds: &str,
        individual: &[&str],
    ) -> Columns {
        let (machine, path) = (
            example(machine).display().to_string(),
            self.path("plain.csv"),
        );
        let arguments = [
            "simulate",
            &machine,
            "--scenario",
            scenario,
            "--duration-s",
            seconds,
            "--seed",
            "5",
            "-o",
            &path,
        ];
        loadtwin(&[&arguments[..], individual].concat());
        let text = std::fs::read_to_string(path).unwrap();
        let is_comment = |line: &&str| line.starts_with('#');
        let comments = text.lines().filter(is_comment).map(String::from);
        let mut lines = text.lines().filter(|line| !is_comment(line));
        let cells = |line: &str| line.split(',').map(String::from).collect();
        let head = cells(lines.next().unwrap());
        Columns {
            comments: comments.collect(),
            head,
            rows: lines.map(cells).collect(),
        }
    }

    fn replayed(&self, machine: &Path, columns: &Columns) -> Value {
        let path = self.path("changed.csv");
        let rows = columns.rows.iter().map(|row| row.join(","));
        let text: Vec<String> = (columns.comments.iter().cloned())
            .chain([columns.head.join(",")])
            .chain(rows)
            .collect();
        std::fs::write(&path, text.join("\n") + "\n").unwrap();
        let machine = machine.display().to_string();
        serde_json::from_slice(&loadtwin(&["replay", &machine, &path, "--json"])).unwrap()
    }

    /// The description `name` of the gearbox with `to` in place of `from`.
    fn described(&self, from: &str, to: &str) -> PathBuf {
        let text = std::fs::read_to_string(example("gearbox/machine.toml")).unwrap();
        assert!(text.contains(from));
        let path = self.folder.path().join("machine.toml");
        std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
        let map = example("gearbox/sensitivity.csv");
        std::fs::copy(map, self.folder.path().join("sensitivity.csv")).unwrap();
        path
    }
}

#[track_caller]
fn assert_cause(found: &Value, kind: &str, what: &str) {
    let cause = &found["consistency"]["cause"];
    assert_eq!(cause["kind"], kind, "{}", found["consistency_note"]);
    assert!(cause["what"].as_str().unwrap().contains(what), "{cause}");
    let note = found["consistency_note"].as_str().unwrap();
    assert!(note.contains(kind) && note.lines().count() == 1, "{note}");
}

#[test]
fn a_gearbox_names_sign_unit_swap_and_counts() {
    let bench = Bench::new();
    let machine = example("gearbox/machine.toml");
    let plain = bench.simulated("gearbox/machine.toml", "torque-ramps", "40");
    let negative = |x: f64| format!("{}", -x);
    let cases = [
        (plain.with(&["ta2"], negative), "sign", "ta2"),
        (
            plain.with(&["ta1", "ta2", "ta3"], negative),
            "sign",
            "ta1, ta2, ta3",
        ),
        (
            plain.with(&["ta3"], |x| format!("{}", 1e6 * x)),
            "unit",
            "ta3",
        ),
        (
            plain.with(&["ta3"], |x| format!("{}", 2.0 * x)),
            "unit",
            "ta3, times 0.5",
        ),
        (
            plain.with(&["ta1", "ta2", "ta3"], |x| format!("{}", 1e6 * x)),
            "unit",
            "ta1, ta2, ta3, times 0.000001",
        ),
        (
            plain.with(&["ta1", "ta2", "ta3"], |x| format!("{}", 2.0 * x)),
            "unit",
            "ta1, ta2, ta3, times 0.5",
        ),
        (
            plain.with(&["index"], |_| String::new()),
            "index",
            "no pulse in column index",
        ),
        (plain.swapped("ta1", "ta3"), "swap", "ta1 and ta3"),
        (
            plain.with(&["ta3"], |x| format!("{}", 0.8 * x)),
            "scale",
            "ta3 reads with gain 0.80",
        ),
        (
            plain.with(&["ta2"], |x| format!("{}", 1e-5 + x)),
            "zero",
            "ta2 reads 9.9",
        ),
        (
            plain.with(&["ta1", "ta2", "ta3"], |x| format!("{}", 1e3 * x)),
            "unit",
            "ta1, ta2, ta3, times 0.001",
        ),
        (
            plain.with(&["encoder_main", "index"], |x| format!("{}", x % 65536.0)),
            "counts",
            "encoder_main begins anew after 65536 counts",
        ),
    ];
    let found = bench.replayed(&machine, &plain);
    assert!(found["consistency_note"].is_null(), "{found}");
    for (columns, kind, what) in cases {
        assert_cause(&bench.replayed(&machine, &columns), kind, what);
    }
    let other = bench.described("counts_per_turn = 16384", "counts_per_turn = 8192");
    assert_cause(
        &bench.replayed(&other, &plain),
        "counts",
        "16384 counts of encoder_main",
    );
}

/// Without the angle another place of the index pulse may fit by chance.
#[test]
fn an_encoder_that_stops_counting_is_named_before_any_other_cause() {
    let bench = Bench::new();
    let mut columns = bench.simulated("gearbox/machine.toml", "turbulent", "60");
    let at = columns.place("encoder_main");
    let from = columns.rows.len() / 3;
    let stuck = columns.rows[from][at].clone();
    for row in columns.rows.iter_mut().skip(from) {
        row[at].clone_from(&stuck);
    }
    let found = bench.replayed(&example("gearbox/machine.toml"), &columns);
    assert_cause(&found, "sensor", "encoder_main is stuck");
}

/// The description before `loadtwin calibrate`, on the recording that the project ships.
#[test]
fn a_description_that_is_not_calibrated_is_named() {
    let recording = example("gearbox/start-stop.parquet").display().to_string();
    for (machine, kind) in [("machine", Some("scale")), ("calibrated", None)] {
        let machine = example(&format!("gearbox/{machine}.toml"))
            .display()
            .to_string();
        let found = loadtwin(&["replay", &machine, &recording, "--json"]);
        let found: Value = serde_json::from_slice(&found).unwrap();
        let cause = &found["consistency"]["cause"];
        assert_eq!(
            cause["kind"].as_str(),
            kind,
            "{}",
            found["consistency_note"]
        );
        if kind.is_some() {
            assert!(
                cause["what"].as_str().unwrap().starts_with("ta3 "),
                "{cause}"
            );
            assert!(
                cause["remedy"]
                    .as_str()
                    .unwrap()
                    .contains("loadtwin calibrate")
            );
        }
        let text = loadtwin(&["replay", &machine, &recording, "--all-sensors"]);
        let text = String::from_utf8(text).unwrap();
        let mut notes = text.lines().filter(|line| line.contains("consistency: "));
        // One set of the calibrated description has a gauge that its model does not fit.
        let expected = if kind.is_some() {
            notes.next().is_some()
        } else {
            notes.all(|line| line.starts_with("high-speed-housing-3: "))
        };
        assert!(expected, "{text}");
    }
}

#[test]
fn other_machines_name_sign_and_unit_and_are_silent_where_nothing_is_wrong() {
    let bench = Bench::new();
    let negative = |x: f64| format!("{}", -x);
    let rotor = example("rotor/machine.toml");
    let plain = bench.simulated("rotor/machine.toml", "constant", "2");
    assert!(bench.replayed(&rotor, &plain)["consistency_note"].is_null());
    assert_cause(
        &bench.replayed(&rotor, &plain.with(&["y5"], negative)),
        "sign",
        "y5",
    );
    let in_mm = plain.with(&["x5", "y5", "x32", "y32"], |x| format!("{}", 1e3 * x));
    assert_cause(&bench.replayed(&rotor, &in_mm), "unit", "times 0.001");
    assert_cause(
        &bench.replayed(&rotor, &plain.swapped("x5", "y32")),
        "swap",
        "x5 and y32",
    );
    // A bearing's calibration is that of one specimen.
    let calibrated = &["--individual", "101"][..];
    for (machine, scenario, seconds, individual) in [
        ("bearing/calibrated.toml", "lc1", "20", calibrated),
        ("tool-drive/machine.toml", "reversals", "20", &[]),
        ("tool-drive/machine.toml", "steps", "20", &[]),
        ("gearbox/machine.toml", "steps", "40", &[]),
        ("gearbox/machine.toml", "turbulent", "40", &[]),
        ("gearbox/machine.toml", "reversals", "40", &[]),
    ] {
        let plain = bench.simulated_as(machine, scenario, seconds, individual);
        let found = bench.replayed(&example(machine), &plain);
        let note = &found["consistency_note"];
        assert!(note.is_null(), "{machine} {scenario}: {note}");
    }
}
