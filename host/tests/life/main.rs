//! `loadtwin life` on the real binary and the sequence of ASTM E1049-85, figure 6: cycles and
//! damage by hand, equivalent torque and bearing life, merging of files, page, refusals.

mod noise;

use std::fs;
use std::process::{Command, Output};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as STANDARD_BASE64;
use serde_json::{Value, json};
use tempfile::TempDir;

/// ASTM E1049-85, figure 6.
const STANDARD: [f64; 9] = [-2.0, 1.0, -3.0, 5.0, -1.0, 3.0, -4.0, 4.0, -2.0];

/// Its cycles: range, count.
const CYCLES: [[f64; 2]; 5] = [[3.0, 0.5], [4.0, 1.5], [6.0, 0.5], [8.0, 1.0], [9.0, 0.5]];

/// On levels 1 N m wide, each reversal a turning point.
const SCALE: [&str; 6] = ["--load", "torque", "--range", "-64:64", "--gate", "1"];

struct Bench(TempDir);

impl Bench {
    /// A folder with a recording of the standard's sequence, in one file and in two.
    fn new() -> Self {
        let bench = Self(tempfile::tempdir().unwrap());
        bench.record("all.csv", &STANDARD);
        bench.record("first.csv", &STANDARD[..4]);
        bench.record("later.csv", &STANDARD[4..]);
        bench
    }

    fn record(&self, name: &str, torque: &[f64]) {
        let rows: Vec<String> = (torque.iter().enumerate())
            .map(|(i, torque)| format!("{:.1},{torque},0.628\n", i as f64 / 10.0))
            .collect();
        let rows = rows.concat();
        let text = format!("t [s],torque [Nm],speed [rad/s]\n{rows}");
        fs::write(self.0.path().join(name), text).unwrap();
    }

    fn run(&self, arguments: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_loadtwin"))
            .current_dir(self.0.path())
            .arg("life")
            .args(arguments)
            .output()
            .unwrap()
    }

    /// What is reported of the torque.
    fn torque(&self, arguments: &[&str]) -> Value {
        let output = self.run(&[arguments, &SCALE, &["--json"]].concat());
        let error = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{error}");
        let report: Value = serde_json::from_slice(&output.stdout).unwrap();
        report["loads"]["torque"].clone()
    }
}

#[test]
fn the_example_of_the_standard_is_counted() {
    let bench = Bench::new();
    let torque = bench.torque(&["all.csv", "--exponents", "3", "--equivalent-cycles", "1"]);
    assert_eq!(torque["cycles"], json!(CYCLES));
    let sum: f64 = CYCLES.iter().map(|[range, n]| n * range.powi(3)).sum();
    let equivalent = torque["damage_equivalent_load"]["3"].as_f64().unwrap();
    assert!((equivalent / sum.cbrt() - 1.0).abs() < 1e-9, "{torque}");
    let machine = &torque["machines"][0];
    assert_eq!(machine["samples"]["seen"], 9);
    assert_eq!(machine["extremes"][0]["load"], -4.0);
}

#[test]
fn files_of_one_machine_are_joined_and_machines_are_added() {
    let bench = Bench::new();
    let joined = bench.torque(&["first.csv", "later.csv"]);
    assert_eq!(joined["cycles"], json!(CYCLES));
    assert_eq!(joined["machines"][0]["samples"]["restarts"], 1);
    let added = bench.torque(&["first.csv", "later.csv", "--machines"]);
    assert_eq!(added["machines"].as_array().unwrap().len(), 2);
    // The range of 9 is between both files.
    let ranges = added["cycles"].as_array().unwrap();
    assert!(ranges.iter().all(|cycle| cycle[0] != 9.0), "{added}");
}

#[test]
fn damage_gear_and_bearing_follow_from_the_counts() {
    let bench = Bench::new();
    let turns = ["--speed", "speed", "--ratio", "2"];
    let parts = [
        "--gear",
        "6.6",
        "--bearing",
        "100:3",
        "--sn",
        "1e3:8,1e6:0.8",
    ];
    let torque = bench.torque(&[&["all.csv"][..], &turns, &parts].concat());
    // Slope 3 through 8 at 1000 cycles.
    let damage: f64 = CYCLES
        .iter()
        .map(|[range, n]| n * (range / 8.0).powi(3) / 1e3)
        .sum();
    let found = torque["damage"].as_f64().unwrap();
    assert!((found / damage - 1.0).abs() < 1e-9, "{found} {damage}");
    for shaft in 0..2 {
        let equivalent = torque["equivalent_torque"][shaft].as_f64().unwrap();
        // Between 3 and 5, in bins of 4.
        assert!((3.0..6.0).contains(&equivalent), "{torque}");
    }
    assert!(
        torque["bearing"]["l10_turns"].as_f64().unwrap() > 1e9,
        "{torque}"
    );
}

#[test]
fn counts_are_written_as_a_table() {
    let bench = Bench::new();
    bench.torque(&["all.csv", "-o", "counts.parquet"]);
    let written = fs::read(bench.0.path().join("counts.parquet")).unwrap();
    assert!(written.starts_with(b"PAR1"));
    // Its own output is replaced, another file is not.
    bench.torque(&["later.csv", "-o", "counts.parquet"]);
    fs::write(bench.0.path().join("other.parquet"), "notes").unwrap();
    let output = bench.run(&[&["all.csv", "-o", "other.parquet"][..], &SCALE].concat());
    assert!(!output.status.success());
}

#[test]
fn a_page_shows_spectra_matrix_and_turns() {
    let bench = Bench::new();
    let turns = ["--speed", "speed", "--exponents", "3"];
    let options = ["--equivalent-cycles", "1", "--report", "page.html"];
    bench.torque(&[&["all.csv"][..], &turns, &options].concat());
    let page = fs::read_to_string(bench.0.path().join("page.html")).unwrap();
    let (_, data) = page.split_once("id=\"data\">").unwrap();
    let (data, _) = data.split_once("</script>").unwrap();
    let data: Value = serde_json::from_str(data).unwrap();
    let plots = data["plots"].as_array().unwrap();
    let titles: Vec<&Value> = plots.iter().map(|plot| &plot["title"]).collect();
    let expected = [
        "Range over cumulative cycles",
        "Rainflow matrix, cycles",
        "Level crossings upwards",
        "Time at load",
        "Turns at load",
    ];
    assert_eq!(titles, expected);
    let mut sum = 0.0;
    let cumulative: Vec<u8> = (CYCLES.iter().rev())
        .flat_map(|[_, count]| {
            sum += count;
            f64::to_le_bytes(sum)
        })
        .collect();
    assert_eq!(plots[0]["own"]["x"], STANDARD_BASE64.encode(cumulative));
    let sum: f64 = CYCLES.iter().map(|[range, n]| n * range.powi(3)).sum();
    assert!(page.contains(&format!("<td>{:.2}</td>", sum.cbrt())));
    // Without a speed no turns.
    bench.torque(&["all.csv", "--report", "page.html"]);
    let page = fs::read_to_string(bench.0.path().join("page.html")).unwrap();
    assert!(page.contains("Time at load") && !page.contains("Turns at load"));
}

#[test]
fn what_cannot_be_counted_is_refused_in_one_line() {
    let bench = Bench::new();
    bench.record("constant.csv", &[5.0; 20]);
    let with = |extra: &[&'static str]| [&["all.csv"][..], &SCALE, extra].concat();
    for (arguments, part) in [
        (with(&["--exponents", "0"]), "exponent 0: allowed: above 0"),
        (
            with(&["--sn", "1e4:5,1e6:9"]),
            "points by increasing cycles, with falling range",
        ),
        (with(&["--sn", "1e4:5"]), "at least 2"),
        (
            with(&["--equivalent-cycles", "0"]),
            "equivalent cycles 0: allowed: above 0",
        ),
        (
            with(&["--speed", "speed", "--gear", "0"]),
            "exponent of the gear 0: allowed: above 0",
        ),
        (
            with(&["--speed", "speed", "--ratio", "0"]),
            "--ratio 0: allowed: above 0",
        ),
        (
            vec!["all.csv", "--load", "torque", "--range", "-4:4"],
            "reaches from -4 to 5, beyond its range -4 to 4 in 2 samples: give a range that covers it",
        ),
        (
            vec!["all.csv", "--load", "torque", "--range", "4:4"],
            "allowed: FROM below TO",
        ),
        (
            vec!["all.csv", "--load", "torque", "--gate", "100"],
            "--gate 100: allowed for torque: above 0, below",
        ),
        (
            vec!["all.csv", "--load", "force"],
            "no column \"force\"; found: ",
        ),
        (vec!["all.csv"], "name a column to count with --load"),
    ] {
        let output = bench.run(&arguments);
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success(), "{arguments:?}");
        assert!(error.contains(part), "{arguments:?}: {error}");
        assert_eq!(error.trim_end().lines().count(), 1, "{error}");
    }
    // A constant load has no cycles and no damage.
    let constant = bench.torque(&["constant.csv", "--exponents", "3"]);
    assert_eq!(constant["damage_equivalent_load"]["3"], 0.0);
}
