//! `loadtwin init` on recordings of every kind of machine: descriptions that it begins are valid.
//! Once the marked places are filled in, those of drivetrains, rotor and drive replay to the
//! figures of the shipped descriptions, within 2 %.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use loadtwin::init::MARK;
use serde_json::Value;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn run(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_loadtwin"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .expect("runs")
}

fn done(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    let reason = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{arguments:?}: {reason}");
    String::from_utf8(output.stdout).expect("text")
}

/// The description with the value of each marked field replaced: by the table, then by the name in
/// it, then by the field. What was not marked stays; a marked field without an entry, too.
fn filled(text: &str, values: &BTreeMap<&str, &str>) -> String {
    let (mut table, mut name, mut marked) = (String::new(), String::new(), false);
    let mut used = BTreeSet::new();
    let mut lines = Vec::new();
    for line in text.lines() {
        if line.starts_with('[') {
            line.trim_matches(['[', ']']).clone_into(&mut table);
            name.clear();
        }
        if let Some((_, value)) = line.split_once("name = ").filter(|(key, _)| key.is_empty()) {
            value.trim_matches('"').clone_into(&mut name);
        }
        let key = line.split(" = ").next().unwrap_or_default();
        let places = [
            format!("{table}.{name}.{key}"),
            format!("{table}.{key}"),
            format!("{key} {name}"),
        ];
        let place = places
            .iter()
            .find(|place| values.contains_key(place.as_str()));
        match place.filter(|_| marked && !line.starts_with('#')) {
            Some(place) => {
                lines.push(values[place.as_str()].to_owned());
                used.insert(place.clone());
            }
            None => lines.push(line.to_owned()),
        }
        marked = line.starts_with(MARK) || (marked && line.starts_with('#'));
    }
    let unused: Vec<_> = values.keys().filter(|key| !used.contains(**key)).collect();
    assert!(unused.is_empty(), "not marked: {unused:?} in\n{text}");
    lines.join("\n") + "\n"
}

fn nmae(folder: &Path, machine: &str, recording: &str) -> BTreeMap<String, f64> {
    let text = done(folder, &["replay", machine, recording, "--json"]);
    let value: Value = serde_json::from_str(&text).expect("JSON");
    let loads = value["loads"].as_object().expect("loads");
    let figure = |load: &Value| load["nmae_percent"]["full"].as_f64().expect("a figure");
    loads
        .iter()
        .map(|(name, load)| (name.clone(), figure(load)))
        .collect()
}

/// Fills in `values` and replays; `machine`: the shipped description beside.
fn compared(
    machine: &Path,
    recording: &str,
    folder: &Path,
    values: &[(&str, &str)],
    loads: &[(&str, &str)],
) {
    done(folder, &["init", recording, "-o", "begun.toml"]);
    let text = std::fs::read_to_string(folder.join("begun.toml")).expect("written");
    let values: BTreeMap<&str, &str> = values.iter().copied().collect();
    let text = filled(&text, &values);
    std::fs::write(folder.join("filled.toml"), text).expect("written");
    let shipped = nmae(folder, machine.to_str().expect("a name"), recording);
    let ours = nmae(folder, "filled.toml", recording);
    for (name, shipped_name) in loads {
        let (found, expected) = (ours[*name], shipped[*shipped_name]);
        assert!(
            (found - expected).abs() < 0.02 * expected.max(0.5),
            "{name}: {found} for {expected}"
        );
    }
}

/// A folder with a recording of the gearbox and the maps that its description names.
fn bench() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let copy = |from: &str, to: &str| {
        std::fs::copy(root().join("examples").join(from), folder.path().join(to)).expect("copied");
    };
    copy("gearbox/sensitivity.csv", "sensitivity.csv");
    copy("gearbox/start-stop.parquet", "start-stop.parquet");
    folder
}

fn simulated(folder: &Path, machine: &Path, name: &str, arguments: &[&str]) {
    let machine = machine.to_str().expect("a name");
    let all = [&["simulate", machine, "-o", name][..], arguments].concat();
    done(folder, &all);
}

#[test]
fn four_gauges_and_an_encoder() {
    let folder = bench();
    let machine = root().join("examples/bench/machine.toml");
    let arguments = ["--duration-s", "20", "--seed", "1"];
    simulated(folder.path(), &machine, "bench.csv", &arguments);
    let map = [
        ("drivetrain.nominal_speed_rad_s", "nominal_speed_rad_s = 25"),
        (
            "drivetrain.inertia.input.moment_kg_m2",
            "moment_kg_m2 = 1.8",
        ),
        (
            "drivetrain.inertia.input.drag_nm_s_per_rad",
            "drag_nm_s_per_rad = 0.15",
        ),
        (
            "drivetrain.inertia.output.moment_kg_m2",
            "moment_kg_m2 = 2.6",
        ),
        (
            "drivetrain.inertia.output.drag_nm_s_per_rad",
            "drag_nm_s_per_rad = 0.2",
        ),
        (
            "drivetrain.shaft.shaft.stiffness_nm_per_rad",
            "stiffness_nm_per_rad = 6.0e4",
        ),
        (
            "drivetrain.shaft.shaft.damping_nm_s_per_rad",
            "damping_nm_s_per_rad = 25",
        ),
        ("drivetrain.load.nominal_nm", "nominal_nm = 500"),
        ("encoder.counts_per_turn", "counts_per_turn = 4096"),
        ("channel.left_upper.sensitivity", "sensitivity = 0.6"),
        ("channel.left_lower.sensitivity", "sensitivity = -0.6"),
        ("channel.right_upper.sensitivity", "sensitivity = -0.6"),
        ("channel.right_lower.sensitivity", "sensitivity = 0.6"),
        ("channel.noise_std", "noise_std = 0.3"),
    ];
    let loads = [("input", "motor_torque"), ("output", "brake_torque")];
    compared(&machine, "bench.csv", folder.path(), &map, &loads);
}

#[test]
fn places_that_are_not_filled_in_are_noted() {
    let folder = bench();
    let machine = root().join("examples/bench/machine.toml");
    simulated(folder.path(), &machine, "bench.csv", &["--duration-s", "4"]);
    done(folder.path(), &["init", "bench.csv", "-o", "mine.toml"]);
    let path = folder.path().join("mine.toml");
    let text = std::fs::read_to_string(&path).expect("a description");
    let marked: Vec<usize> = (text.lines().zip(1..))
        .filter(|(line, _)| line.starts_with(MARK))
        .map(|(_, number)| number)
        .collect();
    let noted = || {
        let output = run(folder.path(), &["replay", "mine.toml", "bench.csv"]);
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let expected = format!(
        "mine.toml: {} values are marked `# TO FILL IN`, the first in line {}",
        marked.len(),
        marked[0]
    );
    assert!(noted().starts_with(&expected), "{}", noted());
    let without: Vec<&str> = (text.lines())
        .filter(|line| !line.starts_with(MARK))
        .collect();
    std::fs::write(&path, without.join("\n")).expect("written");
    assert!(!noted().contains("TO FILL IN"), "{}", noted());
}

#[test]
fn the_gearbox_with_its_index_and_more_gauges_than_an_estimator_takes() {
    let folder = bench();
    let machine = root().join("examples/gearbox/machine.toml");
    let map = [
        (
            "drivetrain.nominal_speed_rad_s",
            "nominal_speed_rad_s = 2.72",
        ),
        (
            "drivetrain.inertia.input.moment_kg_m2",
            "moment_kg_m2 = 3.0e5",
        ),
        (
            "drivetrain.inertia.input.drag_nm_s_per_rad",
            "drag_nm_s_per_rad = 1100",
        ),
        (
            "drivetrain.inertia.output.moment_kg_m2",
            "moment_kg_m2 = 40",
        ),
        (
            "drivetrain.inertia.output.speed_ratio",
            "speed_ratio = 61.8",
        ),
        (
            "drivetrain.inertia.output.drag_nm_s_per_rad",
            "drag_nm_s_per_rad = 0.3",
        ),
        (
            "drivetrain.shaft.shaft.stiffness_nm_per_rad",
            "stiffness_nm_per_rad = 4.0e7",
        ),
        (
            "drivetrain.shaft.shaft.damping_nm_s_per_rad",
            "damping_nm_s_per_rad = 4.0e4",
        ),
        ("drivetrain.load.input.nominal_nm", "nominal_nm = 312e3"),
        ("drivetrain.load.output.nominal_nm", "nominal_nm = 5050"),
        ("index.index.angle_rad", "angle_rad = 0.5"),
        (
            "encoder.encoder_hss.counts_per_turn",
            "counts_per_turn = 1024",
        ),
        (
            "channel.sensitivity",
            "sensitivity_map = \"sensitivity.csv\"",
        ),
        ("channel.noise_std", "noise_std = 0.3e-6"),
        (
            "sensor_set.first.channels",
            "channels = [\"ta1\", \"ta2\", \"ta3\"]",
        ),
        ("sensor_set.first.encoders", "encoders = [\"encoder_main\"]"),
    ];
    let loads = [("input", "main_shaft"), ("output", "high_speed_shaft")];
    compared(&machine, "start-stop.parquet", folder.path(), &map, &loads);
}

#[test]
fn a_rotor_with_displacement_sensors() {
    let folder = bench();
    let machine = root().join("examples/rotor/machine.toml");
    simulated(
        folder.path(),
        &machine,
        "rotor.parquet",
        &["--duration-s", "4", "--seed", "1"],
    );
    done(
        folder.path(),
        &["init", "rotor.parquet", "-o", "rotor.toml"],
    );
    let begun = std::fs::read_to_string(folder.path().join("rotor.toml")).expect("written");
    // The shaft is a drawing; filled in as a whole from the shipped one, the sensors are those found.
    let shipped = std::fs::read_to_string(&machine).expect("read");
    let shaft = &shipped
        [shipped.find("[rotor]").expect("a rotor")..shipped.find("# Proximity").expect("sensors")];
    let sensors = begun.find("[[channel]]").expect("channels");
    let head = &begun[..begun.find("[rotor]").expect("a rotor")];
    let text = format!("{head}{shaft}{}", &begun[sensors..]);
    let at = |node, direction| {
        format!("senses = {{ displacement = {{ node = {node}, direction_deg = {direction} }} }}")
    };
    let places = [at(5, 0), at(5, 90), at(32, 0), at(32, 90)];
    let values: BTreeMap<&str, &str> = [
        ("channel.x5.senses", places[0].as_str()),
        ("channel.y5.senses", places[1].as_str()),
        ("channel.x32.senses", places[2].as_str()),
        ("channel.y32.senses", places[3].as_str()),
        ("reference.f1x.load", "load = \"disc1_x\""),
        ("reference.f1y.load", "load = \"disc1_y\""),
        ("reference.f2x.load", "load = \"disc2_x\""),
        ("reference.f2y.load", "load = \"disc2_y\""),
        ("channel.noise_std", "noise_std = 1e-7"),
    ]
    .into();
    let text = filled(&text, &values);
    std::fs::write(folder.path().join("filled.toml"), text).expect("written");
    let shipped = nmae(
        folder.path(),
        machine.to_str().expect("a name"),
        "rotor.parquet",
    );
    let ours = nmae(folder.path(), "filled.toml", "rotor.parquet");
    for (name, expected) in shipped {
        assert!(
            (ours[&name] - expected).abs() < 0.02 * expected.max(0.5),
            "{name}: {} for {expected}",
            ours[&name]
        );
    }
}

#[test]
fn a_drive_by_its_current() {
    let folder = bench();
    let plant = root().join("examples/feed-drive/plant.toml");
    let arguments = [
        "--scenario",
        "reversals",
        "--duration-s",
        "40",
        "--individual",
        "1",
        "--seed",
        "2",
    ];
    simulated(folder.path(), &plant, "drive.csv", &arguments);
    let shipped = root().join("examples/feed-drive/drive.toml");
    let shipped = std::fs::read_to_string(shipped)
        .expect("read")
        .replace("[tuning]\ncutoff_hz = 20\n", "");
    let shipped = shipped.replace("inertia = 0.01", "inertia = 0.01\nnominal = 6");
    std::fs::write(folder.path().join("shipped.toml"), shipped).expect("written");
    done(folder.path(), &["init", "drive.csv", "-o", "begun.toml"]);
    let text = std::fs::read_to_string(folder.path().join("begun.toml")).expect("written");
    assert!(text.contains("[balance]"), "{text}");
    let values: BTreeMap<&str, &str> = [
        (
            "balance.drive",
            "drive = { name = \"current\", unit = \"counts\", gain = 0.008 }",
        ),
        (
            "balance.position",
            "position = { name = \"position\", unit = \"counts\", gain = 7.669904e-4 }",
        ),
        ("balance.inertia", "inertia = 0.01"),
        ("balance.nominal", "nominal = 6"),
    ]
    .into();
    let text = filled(&text, &values);
    // Of the torques only the load cell's is a load on the drive.
    let tables: Vec<&str> = text.split("\n[[balance.load]]").collect();
    let kept = tables
        .iter()
        .skip(1)
        .find(|table| table.contains("process_torque"))
        .expect("a load");
    let text = format!("{}\n[[balance.load]]{kept}", tables[0]);
    std::fs::write(folder.path().join("filled.toml"), text).expect("written");
    let rms = |machine: &str| {
        let text = done(folder.path(), &["replay", machine, "drive.csv", "--json"]);
        let value: Value = serde_json::from_str(&text).expect("JSON");
        value["loads"]["load"]["rms"].as_f64().expect("a figure")
    };
    let (found, expected) = (rms("filled.toml"), rms("shipped.toml"));
    assert!(
        (found / expected - 1.0).abs() < 0.02,
        "{found} for {expected}"
    );
}

#[test]
fn wheel_bearing_is_recognised_and_every_kind_is_valid() {
    let folder = bench();
    let machine = root().join("examples/bearing/machine.toml");
    simulated(
        folder.path(),
        &machine,
        "wheel.csv",
        &["--duration-s", "2", "--seed", "1"],
    );
    let kind = |arguments: &[&str]| {
        let text = done(
            folder.path(),
            &[&["init", "wheel.csv", "--json"][..], arguments].concat(),
        );
        let value: Value = serde_json::from_str(&text).expect("JSON");
        assert!(value["to_fill_in"].as_u64() > Some(3), "{value}");
        value["kind"].as_str().expect("a kind").to_owned()
    };
    assert_eq!(kind(&[]), "bearing");
    assert_eq!(kind(&["--kind", "drivetrain"]), "drivetrain");
    let refused = run(folder.path(), &["init", "wheel.csv", "--kind", "rotor"]);
    assert_eq!(refused.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("a rotor has displacements"));
    done(folder.path(), &["init", "wheel.csv", "-o", "wheel.toml"]);
}

#[test]
fn nothing_edited_is_overwritten() {
    let folder = bench();
    std::fs::write(
        folder.path().join("rec.csv"),
        "t [s],a [Nm],b [rpm]\n0,1,2\n0.01,1,3\n0.02,2,3\n",
    )
    .expect("written");
    done(folder.path(), &["init", "rec.csv", "-o", "machine.toml"]);
    done(folder.path(), &["init", "rec.csv", "-o", "machine.toml"]);
    let path = folder.path().join("machine.toml");
    let text = std::fs::read_to_string(&path).expect("read") + "# mine\n";
    std::fs::write(&path, &text).expect("written");
    let refused = run(folder.path(), &["init", "rec.csv", "-o", "machine.toml"]);
    assert_eq!(refused.status.code(), Some(1));
    assert_eq!(std::fs::read_to_string(&path).expect("read"), text);
    let input = run(
        folder.path(),
        &["init", "rec.csv", "-o", "rec.csv", "--force"],
    );
    assert_eq!(input.status.code(), Some(1));
}

/// A recording of each kind of trouble that people reported is begun all the same.
#[test]
fn descriptions_of_troublesome_files_are_valid() {
    let folder = bench();
    let rows = |header: &str, row: &dyn Fn(u32) -> String| {
        (0..300)
            .map(row)
            .fold(header.to_owned(), |text, row| text + "\n" + &row)
    };
    let texts = [
        rows("t [s],a [µm/m],e [counts]", &|i| {
            format!("{},{i},{}", f64::from(i / 10), i * 3)
        }),
        rows("a [µm/m],e [counts]", &|i| format!("{i},{}", i * 3)),
        rows("0,1,2.5,3", &|i| {
            format!("{},{},{},4", i + 1, f64::from(i % 7) * 0.3, i % 5)
        }),
        rows("Date:;2020\n;Velocity;Torque\nms;rpm;%", &|i| {
            format!("{}.0;{i};1.5", 40 * i)
        }),
        rows(
            "%note\n%Time [ms], Encoder [counts], Current [Amps]",
            &|i| format!("{:.3},{i},0.5", f64::from(i) * 1e-3),
        ),
        rows("t [s],a [µm/m],a [µm/m],text,b [µm/m]", &|i| {
            format!("{},{i},{i},x,{i}", f64::from(i) * 0.01)
        }),
        rows("t [s],a [mV/V],b [Nm],°C", &|i| {
            format!("{},{},{i},20", f64::from(i) * 0.01, f64::from(i) * 1e-4)
        }),
    ];
    for (i, text) in texts.iter().enumerate() {
        std::fs::write(folder.path().join("rec.csv"), text).expect("written");
        let name = format!("machine-{i}.toml");
        done(folder.path(), &["init", "rec.csv", "-o", &name]);
        done(folder.path(), &["build", &name, "-o", "x.image"]);
    }
    std::fs::write(folder.path().join("rec.csv"), b"\x1f\x8b\x08\0").expect("written");
    let refused = run(folder.path(), &["init", "rec.csv"]);
    assert!(String::from_utf8_lossy(&refused.stderr).contains("gzip"));
}

/// What `init --board` writes for each board is valid at once, and an image that the board serves.
#[test]
fn a_description_for_a_board_is_an_image_that_it_serves() {
    let folder = tempfile::tempdir().expect("a folder");
    for (board, gauges, encoders) in [("nucleo-g474re", 4, 1), ("emulated", 8, 2)] {
        let said = done(
            folder.path(),
            &["init", "--board", board, "-o", "mine.toml"],
        );
        let text = std::fs::read_to_string(folder.path().join("mine.toml")).expect("written");
        let marks = text.matches(MARK).count();
        assert!(
            said.contains(&format!("{marks} places to fill in")),
            "{said}"
        );
        assert_eq!(text.matches("[[channel]]").count(), gauges);
        assert_eq!(text.matches("[[encoder]]").count(), encoders);
        let arguments = ["build", "mine.toml", "--board", board, "-o", "mine.image"];
        done(folder.path(), &arguments);
        // As it stands, and with the commented index pulse.
        let with_index = text
            .replace("# [index]", "[index]")
            .replace("# name = \"index\"", "name = \"index\"")
            .replace("# encoder = ", "encoder = ")
            .replace("# angle_rad", "angle_rad");
        assert_ne!(with_index, text);
        std::fs::write(folder.path().join("index.toml"), with_index).expect("written");
        let arguments = ["build", "index.toml", "--board", board, "-o", "index.image"];
        done(folder.path(), &arguments);
        for name in ["mine.toml", "mine.image", "index.image"] {
            std::fs::remove_file(folder.path().join(name)).expect("ours");
        }
    }
    let both = run(
        folder.path(),
        &["init", "a.csv", "--board", "nucleo-g474re"],
    );
    assert_eq!(both.status.code(), Some(2));
    assert_eq!(run(folder.path(), &["init"]).status.code(), Some(2));
}
