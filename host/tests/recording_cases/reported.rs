//! Files made after reports of people who work with such data, one folder for each kind; all but
//! the logs are the rows of 29 to 35 s of the shipped recording (the index: the whole of it).

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

/// What comes of a file.
enum Right {
    /// Error of the whole recording [% of nominal], and its samples.
    Error(f64, u64),
    /// One line with this.
    Refused(&'static str),
    /// Samples that `prove` finds in a log.
    Proved(u64),
}

use Right::{Error, Proved, Refused};

const PLAIN: Right = Error(1.69, 3000);

/// File, machine, and what is right.
const TABLE: [(&str, &str, Right); 52] = [
    (
        "01-union-timebase/rec.csv",
        "calibrated",
        Refused("row 2 (line 3) at t = 0.0013 s is not on the clock"),
    ),
    (
        "01-union-timebase/rec-nan.csv",
        "calibrated",
        Refused("row 2 (line 3) at t = 0.0013 s is not on the clock"),
    ),
    (
        "02-rate-doubles/rec.csv",
        "calibrated",
        Refused("row 1502 (line 1503): from t = 3.001 s on rows come every 0.001000 s"),
    ),
    (
        "03-time-rounded/rec.csv",
        "calibrated",
        Refused("row 2 (line 3): time goes from 0 s to 0 s"),
    ),
    ("04-semicolon-comma-cp1252/rec.csv", "calibrated", PLAIN),
    (
        "04-semicolon-comma-cp1252/rec-utf8.csv",
        "calibrated",
        PLAIN,
    ),
    ("06-excel-sep-line/rec.csv", "calibrated", PLAIN),
    ("11-epoch-time/rec.csv", "calibrated", PLAIN),
    (
        "13-wide-index/long-w20.parquet",
        "calibrated",
        Error(1.44, 11_500),
    ),
    (
        "13-wide-index/long-w60.parquet",
        "calibrated",
        Error(1.44, 11_500),
    ),
    (
        "14b-no-time-column/rec.csv",
        "rp2",
        Refused("is sampled every 0.000500 s (2000 Hz); allowed: 0.002000 s (500 Hz)"),
    ),
    ("19-jitter/rec-45pct.csv", "calibrated", PLAIN),
    ("19-jitter/rec-45pct.csv", "gap1", PLAIN),
    ("21-mdf-first-group-empty/rec.mf4", "calibrated", PLAIN),
    ("22-mdf-first-group-one-sample/rec.mf4", "calibrated", PLAIN),
    ("23-mdf-second-group-angle/rec.mf4", "calibrated", PLAIN),
    (
        "23-mdf-second-group-angle/control-one-group.mf4",
        "calibrated",
        PLAIN,
    ),
    ("25-mdf-two-recordings/rec.mf4", "calibrated", PLAIN),
    ("26b-mdf-reference-other-group/rec.mf4", "calibrated", PLAIN),
    ("30-mdf-duplicate-name/rec.mf4", "calibrated", PLAIN),
    ("34-mdf-unit-in-conversion/rec.mf4", "calibrated", PLAIN),
    ("37-mdf-number-types/f2.mf4", "calibrated", PLAIN),
    (
        "41-parquet-types/rec-bool-index.parquet",
        "calibrated",
        PLAIN,
    ),
    ("41-parquet-types/rec-decimal.parquet", "calibrated", PLAIN),
    (
        "41-parquet-types/rec-dictionary.parquet",
        "calibrated",
        PLAIN,
    ),
    ("41-parquet-types/rec-float16.parquet", "calibrated", PLAIN),
    ("41-parquet-types/rec-float32.parquet", "calibrated", PLAIN),
    (
        "41-parquet-types/rec-string.parquet",
        "calibrated",
        Refused("column `encoder_main` holds Utf8"),
    ),
    (
        "42-parquet-timestamp/rec-datetimeindex.parquet",
        "calibrated",
        PLAIN,
    ),
    (
        "42-parquet-timestamp/rec-duckdb.parquet",
        "calibrated",
        PLAIN,
    ),
    (
        "42-parquet-timestamp/rec-floatindex.parquet",
        "calibrated",
        PLAIN,
    ),
    (
        "42-parquet-timestamp/rec-pandas-nan.parquet",
        "calibrated",
        PLAIN,
    ),
    (
        "42-parquet-timestamp/rec-polars-duration.parquet",
        "calibrated",
        PLAIN,
    ),
    (
        "42-parquet-timestamp/rec-polars-nan.parquet",
        "calibrated",
        Refused("row 1, column `index`: found `NaN`"),
    ),
    (
        "42-parquet-timestamp/rec-polars.parquet",
        "calibrated",
        PLAIN,
    ),
    (
        "42-parquet-timestamp/rec-timedelta.parquet",
        "calibrated",
        PLAIN,
    ),
    ("60-candump-formats/log-L.txt", "calibrated", Proved(500)),
    ("60-candump-formats/log-tz.txt", "calibrated", Proved(500)),
    ("60-candump-formats/log-x.txt", "calibrated", Proved(500)),
    (
        "60-candump-formats/log-fdclassic.txt",
        "calibrated",
        Proved(500),
    ),
    (
        "60-candump-formats/log-error.txt",
        "calibrated",
        Proved(498),
    ),
    ("60-candump-formats/log-8dec.txt", "calibrated", Proved(500)),
    ("60-candump-formats/log-view.txt", "calibrated", Proved(500)),
    ("60-candump-formats/pycan.asc", "calibrated", Proved(400)),
    ("60-candump-formats/pycan.blf", "calibrated", Proved(400)),
    ("60-candump-formats/log-asc.txt", "calibrated", Proved(500)),
    ("60-candump-formats/log-nano.txt", "calibrated", Proved(500)),
    (
        "60-candump-formats/log-view-ta.txt",
        "calibrated",
        Proved(500),
    ),
    ("60-candump-formats/pycan.trc", "calibrated", Proved(400)),
    ("60-candump-formats/pycan.log", "calibrated", Proved(400)),
    (
        "71-fractional-counts/rec-counts.csv",
        "lsb1",
        Error(1.72, 3000),
    ),
    (
        "71-fractional-counts/control-um.csv",
        "lsb1",
        Error(1.72, 3000),
    ),
];

fn loadtwin(folder: &Path, words: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_loadtwin"));
    command.args(words).current_dir(folder).output().unwrap()
}

/// What differs from `right`; nothing where it is right.
fn flaw(right: &Right, output: &Output) -> Option<String> {
    let message = String::from_utf8_lossy(&output.stderr);
    let found: Value = serde_json::from_slice(&output.stdout).unwrap_or_default();
    match right {
        Refused(says) => {
            let is_right = output.status.code() == Some(1)
                && message.trim_end().lines().count() == 1
                && message.contains(says);
            (!is_right).then(|| format!("{message}{found}"))
        }
        Error(percent, samples) => {
            let error = found["loads"]["main_shaft"]["nmae_percent"]["full"].as_f64();
            let is_right = error.is_some_and(|error| (error - percent).abs() < 0.006)
                && found["samples"] == *samples;
            (!is_right).then(|| format!("{error:?} %, {} samples: {message}", found["samples"]))
        }
        Proved(samples) => (found["samples"] != *samples)
            .then(|| format!("{} samples: {message}", found["samples"])),
    }
}

#[test]
fn every_reported_file_is_read_right_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let archive = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/cases.tar.xz");
    let unpacked = Command::new("python3")
        .args(["-m", "tarfile", "-e", archive])
        .arg(folder.path())
        .status();
    assert!(unpacked.unwrap().success());
    let cases = folder.path().join("cases");
    let mut wrong = Vec::new();
    for (file, machine, right) in &TABLE {
        let machine = format!("machine/{machine}.toml");
        let command = match right {
            _ if file.starts_with("60-") => "prove",
            _ => "replay",
        };
        let output = loadtwin(&cases, &[command, &machine, file, "--json"]);
        if let Some(flaw) = flaw(right, &output) {
            wrong.push(format!("{file} by {machine}: {flaw}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// The unit of each load: of forces N, of moments Nm.
#[test]
fn a_dbc_has_the_unit_of_each_load() {
    let examples = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../examples"));
    for (machine, units) in [
        ("rotor/machine.toml", vec!["N"]),
        ("bearing/calibrated.toml", vec!["N", "N", "N", "Nm", "Nm"]),
        ("gearbox/calibrated.toml", vec!["Nm"]),
    ] {
        let output = loadtwin(examples, &["dbc", machine]);
        let text = String::from_utf8(output.stdout).unwrap();
        let values: Vec<&str> = (text.lines())
            .filter(|line| line.starts_with(" SG_ ") && line.contains("Value :"))
            .collect();
        assert!(values.len() >= units.len(), "{machine}: {text}");
        for (line, unit) in values.iter().zip(units.iter().cycle()) {
            assert!(line.contains(&format!("\"{unit}\"")), "{machine}: {line}");
        }
    }
}
