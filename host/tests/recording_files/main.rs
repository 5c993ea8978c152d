//! One recording as loggers and programs of the trade write it: whatever the
//! format, the types, the groups and the text, it gives the same samples to the
//! bit, or is refused by a line that names the reason.
//!
//! `reference/recording_peer.py` writes the files and says what is right.

#[path = "../reference/python.rs"]
mod python;

use std::path::Path;
use std::process::Command;

use loadtwin::image_build::Sensors;
use loadtwin::machine::Machine;
use loadtwin::recording::{CsvLayout, Reader, Wanted};
use loadtwin::replay::{self, Samples};
use loadtwin_common::io::raw::RawSample;

/// Rows of the recording, from a place with two pulses of the index on.
const ROWS: std::ops::Range<usize> = 14_900..16_400;

fn machine() -> Machine {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    with_one_reference(Machine::load(&here.join("../examples/gearbox/calibrated.toml")).unwrap())
}

/// As the files have.
fn with_one_reference(mut machine: Machine) -> Machine {
    machine.references.retain(|r| r.name == "torque_main");
    machine
}

/// The recording as plain text. Of the strains one is an IEEE half, one a
/// single, one has three decimals, so that each has a type that holds it.
fn plain() -> String {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let wanted = [
        ("ta1", "µm/m"),
        ("ta2", "µm/m"),
        ("ta3", "µm/m"),
        ("encoder_main", "counts"),
        ("index", "counts"),
        ("torque_main", "Nm"),
    ]
    .map(|(name, unit)| Wanted {
        name,
        unit: unit.parse().unwrap(),
        required: true,
    });
    let path = here.join("../examples/gearbox/start-stop.parquet");
    let reader = Reader::open(&path, &CsvLayout::default(), &wanted).unwrap();
    let mut columns = vec![Vec::new(); wanted.len()];
    for block in reader {
        for (column, values) in columns.iter_mut().zip(block.unwrap().columns) {
            column.extend(values.unwrap());
        }
    }
    let mut text = "t [s]".to_owned();
    for want in &wanted {
        text += &format!(",{} [{}]", want.name, want.unit);
    }
    for (i, row) in ROWS.enumerate() {
        let value = |k: usize| columns[k][row];
        // Every eighth below 256 is a half.
        let half = (value(0) * 8.0).round() / 8.0;
        assert!(half.abs() < 256.0);
        let count = |v: f64| {
            if v.is_nan() {
                String::new()
            } else {
                v.to_string()
            }
        };
        text += &format!(
            "\n{},{half},{},{:.3},{},{},{:.2}",
            i as f64 / 500.0,
            f64::from(value(1) as f32),
            value(2),
            value(3),
            count(value(4)),
            value(5),
        );
    }
    text + "\n"
}

/// Writes all files into `folder`.
fn write(base: &Path, folder: &Path) {
    python::output("recording_peer.py", &[base.as_os_str(), folder.as_os_str()]);
}

/// What the estimator gets of a recording.
#[derive(Debug, Default)]
struct Read {
    t: Vec<f64>,
    raw: Vec<RawSample>,
    references: Vec<Vec<u64>>,
    notes: Vec<String>,
}

fn read(machine: &Machine, path: &Path) -> Result<Read, String> {
    let sensors = Sensors::choose(machine, None).unwrap();
    let mut samples = Samples::open(machine, &sensors, path).map_err(|e| e.to_string())?;
    let mut read = Read::default();
    loop {
        let more = samples.next_block(|sample| {
            read.t.push(sample.t);
            read.raw.push(sample.raw);
            let references = sample.references.iter().map(|r| r.to_bits());
            read.references.push(references.collect());
        });
        if !more.map_err(|e| e.to_string())? {
            read.notes = samples.notes();
            return Ok(read);
        }
    }
}

/// The machine with a layout (TOML) of its recordings.
fn with_layout(machine: &Machine, layout: &str) -> Machine {
    let mut machine = machine.clone();
    machine.recording = toml::from_str(layout).unwrap();
    machine.recording.rate_hz = Some(machine.rate_hz);
    machine
}

/// What differs from the plain recording; nothing where it is right.
fn difference(found: &Read, plain: &Read, references: bool) -> Option<String> {
    if found.raw.len() != plain.raw.len() {
        return Some(format!(
            "{} samples for {}",
            found.raw.len(),
            plain.raw.len()
        ));
    }
    for i in 0..plain.raw.len() {
        if (found.t[i] - plain.t[i]).abs() > 1e-9 {
            return Some(format!("row {i}: t = {} for {}", found.t[i], plain.t[i]));
        }
        if found.raw[i] != plain.raw[i] {
            return Some(format!(
                "row {i}: {:?} for {:?}",
                found.raw[i], plain.raw[i]
            ));
        }
        if references && found.references[i] != plain.references[i] {
            return Some(format!("row {i}: another reference"));
        }
    }
    None
}

#[test]
fn every_file_gives_the_same_samples_or_a_refusal() {
    let dir = tempfile::tempdir().unwrap();
    let base = dir.path().join("base.csv");
    let text = plain();
    std::fs::write(&base, &text).unwrap();
    write(&base, dir.path());
    let machine = machine();
    let plain = read(&machine, &base).unwrap();
    let pulses = plain.raw.iter().filter(|raw| raw.index.is_some()).count();
    assert_eq!((plain.raw.len(), pulses), (ROWS.len(), 2));
    assert!(plain.notes.is_empty(), "{:?}", plain.notes);
    // The index as 0 and 1, homed at the count of its row.
    let pulse_text: String = text
        .lines()
        .enumerate()
        .map(|(i, line)| {
            let mut cells: Vec<&str> = line.split(',').collect();
            cells[5] = match cells[5] {
                _ if i == 0 => "index [1]",
                "" => "0",
                _ => "1",
            };
            cells.join(",") + "\n"
        })
        .collect();
    let pulse = dir.path().join("pulse.csv");
    std::fs::write(&pulse, pulse_text).unwrap();
    let pulse = read(&machine, &pulse).unwrap();

    let manifest = std::fs::read(dir.path().join("manifest.json")).unwrap();
    let manifest: serde_json::Value = serde_json::from_slice(&manifest).unwrap();
    let mut wrong = Vec::new();
    let mut refused = 0;
    let files = manifest.as_array().unwrap();
    for entry in files {
        let text = |key: &str| entry[key].as_str().unwrap();
        let (name, expect, says) = (text("file"), text("expect"), text("says"));
        let machine = with_layout(&machine, text("layout"));
        let flaw = match (read(&machine, &dir.path().join(name)), expect) {
            (Err(line), "refused") => {
                refused += 1;
                let is_line = !line.contains('\n') && line.len() < 1000;
                (!(line.contains(says) && is_line)).then_some(line)
            }
            (Ok(found), "refused") => Some(format!("read, {} samples", found.raw.len())),
            (Err(line), _) => Some(line),
            (Ok(found), _) => {
                let expected = if expect == "pulse" { &pulse } else { &plain };
                let said = found.notes.join("; ");
                let is_said = match says {
                    "nothing" => said.is_empty(),
                    says => said.contains(says),
                };
                // Of a part of the samples, the note is what is asked for.
                let differs = (expect != "noted")
                    .then(|| difference(&found, expected, expect != "samples"))
                    .flatten();
                differs.or_else(|| (!is_said).then(|| format!("{says:?} is not said: {said:?}")))
            }
        };
        if let Some(flaw) = flaw {
            wrong.push(format!("{name}: {flaw}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(
        files.len() > 200 && refused > 20,
        "{} {refused}",
        files.len()
    );

    let expected = estimates(&machine, &base);
    for name in [
        "semicolon-comma-windows-1252.csv",
        "pyarrow.parquet",
        "polars.parquet",
        "duckdb.parquet",
        "plain-4.10-2.mf4",
        "devices-0.mf4",
        "half-and-single.mf4",
        "stopped.mf4",
    ] {
        let found = estimates(&machine, &dir.path().join(name));
        assert!(found == expected, "{name}: other estimates");
    }
}

/// Loads and their standard deviations of a replay, as bits.
fn estimates(machine: &Machine, path: &Path) -> Vec<(u32, u32)> {
    let sensors = Sensors::choose(machine, None).unwrap();
    let mut bits = Vec::new();
    replay::run(machine, &sensors, path, |_, estimate, _| {
        let loads = estimate.loads.iter();
        bits.extend(loads.map(|load| (load.value.to_bits(), load.std.to_bits())));
    })
    .unwrap();
    assert!(!bits.is_empty());
    bits
}

#[test]
fn a_layout_file_is_shared_by_machines() {
    let dir = tempfile::tempdir().unwrap();
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/gearbox");
    for name in ["calibrated-maps.csv", "calibrated-noise.csv"] {
        std::fs::copy(here.join(name), dir.path().join(name)).unwrap();
    }
    let description = std::fs::read_to_string(here.join("calibrated.toml")).unwrap();
    let put = |name: &str, text: &str| {
        let path = dir.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let text = plain();
    let base = put("base.csv", &text);
    let logged = text.replace('.', "#").replace(',', ";").replace('#', ",");
    let logged = "catman\nexported\n".to_owned() + &logged.replacen("ta1", "MX840 CH 1", 1);
    let logged = put("logged.txt", &logged);
    let layout = "delimiter = ';'\ndecimal_comma = true\nskip_lines = 2\n";
    let channel = "ta1 = { column = 'MX840 CH 1' }\n";
    put("catman.toml", &format!("{layout}[channels]\n{channel}"));
    put("bare.toml", layout);

    let load = |recording: &str| {
        let text = format!("{description}\n{recording}");
        Machine::load(&put("machine.toml", &text)).map(with_one_reference)
    };
    let expected = read(&machine(), &base).unwrap();
    let named = "[recording]\nlayout = 'catman.toml'\n".to_owned();
    let own = format!("[recording]\nlayout = 'bare.toml'\n[recording.channels]\n{channel}");
    let inline = format!("[recording]\n{layout}[recording.channels]\n{channel}");
    for recording in [named, own, inline] {
        let found = read(&load(&recording).unwrap(), &logged).unwrap();
        assert_eq!(difference(&found, &expected, true), None, "{recording}");
    }
    let given = machine()
        .with_layout(&dir.path().join("catman.toml"))
        .unwrap();
    let found = read(&given, &logged).unwrap();
    assert_eq!(difference(&found, &expected, true), None);

    put("wrong.toml", "delimiter = ';'\nskip_line = 2\n");
    put("circle.toml", "layout = 'circle.toml'\n");
    for (recording, line) in [
        ("layout = 'none.toml'", "none.toml"),
        (
            "layout = 'wrong.toml'",
            "wrong.toml: line 2: unknown field `skip_line`",
        ),
        ("layout = 'circle.toml'", "no further file"),
        (
            "layout = 'catman.toml'\nskip_lines = 1",
            "no other field than `channels`",
        ),
    ] {
        let error = load(&format!("[recording]\n{recording}\n")).unwrap_err();
        assert!(error.to_string().contains(line), "{error}");
    }
}

#[test]
fn fractional_counts_are_rounded_and_reported() {
    let dir = tempfile::tempdir().unwrap();
    let mut machine = machine();
    for channel in &mut machine.channels {
        channel.adc.as_mut().unwrap().lsb = 1e-6;
    }
    let text = plain();
    let readings = dir.path().join("readings.csv");
    std::fs::write(&readings, &text).unwrap();
    let counts = dir.path().join("counts.csv");
    std::fs::write(&counts, text.replace("µm/m", "counts")).unwrap();
    let expected = read(&machine, &readings).unwrap();
    let found = read(&machine, &counts).unwrap();
    assert_eq!(difference(&found, &expected, true), None);
    let [note] = &found.notes[..] else {
        panic!("{:?}", found.notes);
    };
    assert!(note.contains("counts are no whole numbers"), "{note}");
}

#[test]
#[cfg(target_os = "linux")]
fn a_page_that_claims_too_much_is_refused_where_memory_is_short() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let dir = tempfile::tempdir().unwrap();
    let layout = dir.path().join("layout.toml");
    let channels =
        "[channels]\nqm = { column = 'ta1', unit = 'm' }\nvir = { column = 'enc', unit = 'V' }\n";
    std::fs::write(&layout, channels).unwrap();
    let output = Command::new("sh")
        .args([
            "-c",
            "ulimit -v 700000; exec \"$0\" diagnose \"$1\" \"$2\" --layout \"$3\"",
        ])
        .arg(env!("CARGO_BIN_EXE_loadtwin"))
        .arg(here.join("../examples/positioning-axis/machine.toml"))
        .arg(here.join("tests/data/parquet-774M.parquet"))
        .arg(layout)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("is not a whole Parquet file"), "{said}");
    assert_eq!(said.lines().count(), 1, "{said}");
}
