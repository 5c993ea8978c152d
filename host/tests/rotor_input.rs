//! Refusal of wrong rotor descriptions in one line (where, what was found, what is allowed);
//! rotors of other sizes than the example.

use std::path::{Path, PathBuf};
use std::process::Command;

use loadtwin::image_build::{self, Filter, Sensors};
use loadtwin::machine::{BearingAt, Drift, Machine, MachineError, RotorBearing};
use loadtwin::rotor::{RotorFilterDesign, RotorModel, modes};
use loadtwin_common::estimator::Estimator;
use loadtwin_common::image::Image;

fn example() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/rotor/machine.toml")
}

fn machine() -> Machine {
    Machine::load(&example()).unwrap()
}

/// The example with the first `from` replaced by `to`.
fn changed(from: &str, to: &str) -> Result<Machine, MachineError> {
    let text = std::fs::read_to_string(example()).unwrap();
    assert!(text.contains(from), "{from}");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("machine.toml");
    std::fs::write(&path, text.replacen(from, to, 1)).unwrap();
    Machine::load(&path)
}

#[test]
fn what_a_rotor_may_not_be_is_said_in_one_line() {
    for (from, to, said) in [
        (
            "[[rotor.disc]]\nnode = 12",
            "[[rotor.disc]]\nnode = 38",
            ["rotor.disc[1].node", "38", "0 to 37"],
        ),
        (
            "displacement = { node = 5",
            "displacement = { node = 50",
            ["channel[1].senses.displacement.node", "50", "0 to 37"],
        ),
        (
            "mass_kg = 2.65",
            "mass_kg = -2.65",
            ["rotor.disc[1].mass_kg", "-2.65", "> 0"],
        ),
        (
            "[[3.925209e8, 0], [0, 2.572044e9]]",
            "[[4e8, 4e8], [4e8, 4e8]]",
            [
                "rotor.bearing[1].stiffness_n_per_m",
                "400000000",
                "singular",
            ],
        ),
        (
            "[[rotor.bearing]]\nnode = 4",
            "[[rotor.bearing]]\nnode = 33",
            ["rotor.bearing", "1 nodes", "not held"],
        ),
        (
            "speed_rad_s = 87.96",
            "speed_rad_s = 87.96\nschedule_rad_s = [100, 200]",
            ["rotor.speed_rad_s", "87.96", "100 to 200"],
        ),
        (
            "speed_rad_s = 87.96",
            "speed_rad_s = 87.96\nlag_samples = 9",
            ["rotor.lag_samples", "9", "0 to 4"],
        ),
        (
            "noise_std = 1e-7",
            "noise_std = 0.1",
            ["channel[1].noise_std", "0.1 m", "another unit"],
        ),
        (
            "adc = { lsb = 1e-9 }",
            "adc = { lsb = 1e-6 }",
            ["channel[1].adc.lsb", "0.000001 m", "another unit"],
        ),
        (
            "noise_std = 1e-7",
            "noise_std = 1e-7\ndrift = { std = 20, time_s = 600 }",
            ["channel[1].drift.std", "20 m", "another unit"],
        ),
        (
            "noise_std = 1e-7",
            "noise_std = 1e-7\nrunout = [[1e-5, 0]]",
            ["channel[1].runout", "one", "no encoder"],
        ),
        (
            "walk_n_per_sqrt_s = 0.0006",
            "walk_n_per_sqrt_s = 0",
            ["rotor.load[1].walk_n_per_sqrt_s", "0", "> 0"],
        ),
        (
            "rate_hz = 2000",
            "rate_hz = 25",
            ["rate_hz", "25", "two samples a turn, 28.0"],
        ),
    ] {
        let refused = changed(from, to).unwrap_err().to_string();
        println!("{refused}");
        assert!(!refused.contains('\n'), "{refused}");
        for part in said {
            assert!(refused.contains(part), "{part:?} is not in {refused:?}");
        }
    }
}

/// Beside bearings that hold the shaft.
#[test]
fn a_damper_need_not_hold_the_shaft() {
    let damper = "node = 20
stiffness_n_per_m = [[0, 5e3], [-5e3, 0]]
damping_n_s_per_m = [[200, 0], [0, 200]]";
    let first = "[[rotor.bearing]]\nnode = 4";
    let machine = changed(first, &format!("[[rotor.bearing]]\n{damper}\n\n{first}")).unwrap();
    assert_eq!(machine.rotor.as_ref().unwrap().bearings.len(), 3);
    assert_eq!(built(&machine, Filter::Aekf), Ok(()));
}

/// Builds the image with all sensors and starts the line; what `build` says where it refuses.
fn built(machine: &Machine, filter: Filter) -> Result<(), String> {
    let sensors = Sensors::choose(machine, None).unwrap().filtered_by(filter);
    let payload = image_build::image(machine, &sensors).map_err(|error| error.to_string())?;
    Estimator::try_build(Image::from_bytes(&payload).unwrap()).unwrap();
    Ok(())
}

#[test]
fn a_rotor_has_no_filter_of_gains_alone() {
    let refused = built(&machine(), Filter::Steady).unwrap_err();
    assert!(refused.starts_with("--filter: found steady"), "{refused}");
}

#[test]
fn rotors_of_other_sizes_are_filled_up_and_larger_ones_refused() {
    let with_modes = |modes: usize| {
        let mut machine = machine();
        machine.rotor.as_mut().unwrap().reduction.modes = Some(modes);
        built(&machine, Filter::Aekf)
    };
    for modes in [2, 3, 4] {
        assert_eq!(with_modes(modes), Ok(()));
    }
    let refused = "rotor.reduction.modes: found 5, allowed: at most 4 beside the 2 loads";
    assert_eq!(with_modes(5), Err(refused.into()));
}

/// One disc in place of two, one load, six modes.
#[test]
fn a_rotor_with_one_load_has_room_for_more_modes() {
    let mut machine = machine();
    let rotor = machine.rotor.as_mut().unwrap();
    rotor.loads.truncate(1);
    rotor.discs.truncate(1);
    rotor.reduction.modes = Some(6);
    machine.references.truncate(2);
    assert_eq!(built(&machine, Filter::Aekf), Ok(()));
}

#[test]
fn more_drifting_sensors_than_states_are_refused() {
    let mut machine = machine();
    let mut more = machine.channels[0].clone();
    more.name = "x5b".into();
    machine.channels.push(more);
    for channel in &mut machine.channels {
        channel.drift = Some(Drift {
            std: 1e-5,
            time_s: 600.0,
        });
    }
    let refused = built(&machine, Filter::Aekf).unwrap_err();
    assert!(refused.contains("5 channels with a drift"), "{refused}");
    machine.channels.pop();
    assert_eq!(built(&machine, Filter::Aekf), Ok(()));
}

/// Values in mm under a header that says m.
#[test]
fn readings_in_another_unit_get_a_line() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let loadtwin = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_loadtwin"));
        command.args(arguments).output().unwrap()
    };
    let (machine, right, wrong) = (
        example().display().to_string(),
        path("right.csv"),
        path("wrong.csv"),
    );
    let simulated = loadtwin(&["simulate", &machine, "--scenario", "constant", "-o", &right]);
    assert!(simulated.status.success());
    let text = std::fs::read_to_string(&right).unwrap();
    let mut lines = text.lines();
    let header = lines.find(|line| line.starts_with("t [s]")).unwrap();
    let sensors: Vec<bool> = header
        .split(',')
        .map(|name| name.starts_with('x') || name.starts_with('y'))
        .collect();
    let mut in_mm = format!("{header}\n");
    for line in lines {
        let cells = line.split(',').zip(&sensors).map(|(cell, sensor)| {
            let mm = |metres: f64| (1000.0 * metres).to_string();
            if *sensor {
                mm(cell.parse().unwrap())
            } else {
                cell.into()
            }
        });
        in_mm += &(cells.collect::<Vec<String>>().join(",") + "\n");
    }
    std::fs::write(&wrong, in_mm).unwrap();
    let said = |recording: &str| {
        let output = loadtwin(&["replay", &machine, recording, "--json"]);
        let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        json["consistency_note"].clone()
    };
    assert!(said(&right).is_null());
    let note = said(&wrong);
    let note = note.as_str().unwrap();
    assert!(
        note.contains("unit") && note.contains("times 0.001000"),
        "{note}"
    );
}

/// A seal in the middle whose cross-coupling grows with the speed: `build` and `replay` say where a
/// motion grows, and there one does.
#[test]
fn a_rotor_that_is_unstable_as_described_gets_a_line() {
    let mut machine = machine();
    let rotor = machine.rotor.as_mut().unwrap();
    rotor.schedule_rad_s = Some([20.0, 180.0]);
    rotor.bearings.push(RotorBearing {
        node: 17,
        stiffness_n_per_m: None,
        damping_n_s_per_m: [[0.0; 2]; 2],
        table: [(0.0, 0.0), (200.0, 2e3)]
            .map(|(speed_rad_s, coupled)| BearingAt {
                speed_rad_s,
                stiffness_n_per_m: [[0.0, coupled], [-coupled, 0.0]],
                damping_n_s_per_m: [[0.0; 2]; 2],
            })
            .to_vec(),
    });
    let rotor = machine.rotor.as_ref().unwrap();
    let sensors = Sensors::choose(&machine, None).unwrap();
    let plan = RotorFilterDesign::new(&machine, rotor, &sensors.channels).unwrap();
    let found = plan.instability().unwrap();
    let [from, to] = found.from_to_rad_s;
    let model = RotorModel::new(rotor);
    let most = |speed: f64| {
        (modes(&model, speed, 8).unwrap().into_iter())
            .map(|mode| mode.eigenvalue)
            .max_by(|a, b| a.re.total_cmp(&b.re))
            .unwrap()
    };
    println!("{found:?}");
    assert!(from > 25.0 && to == 180.0, "{found:?}");
    assert!(most(0.97 * from).re < 0.0 && most(1.03 * from).re > 0.0);
    let fastest = most(found.speed_rad_s);
    assert!(
        (found.growth_per_s - fastest.re).abs() < 1e-3 * fastest.re,
        "{fastest:?}"
    );
    assert!((found.frequency_rad_s - fastest.im).abs() < 1e-4 * fastest.im);

    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let (stable, unstable) = (example().display().to_string(), path("unstable.toml"));
    let seal = "\n[[rotor.bearing]]\nnode = 17\nstiffness_n_per_m = [[0, 1e3], [-1e3, 0]]\n\
                damping_n_s_per_m = [[0, 0], [0, 0]]\n";
    let text = std::fs::read_to_string(example()).unwrap();
    let text = text.replace("# Recordings begin", &format!("{seal}\n# Recordings begin"));
    std::fs::write(&unstable, text).unwrap();
    let said = |arguments: &[&str]| -> serde_json::Value {
        let mut command = Command::new(env!("CARGO_BIN_EXE_loadtwin"));
        let output = command.args(arguments).output().unwrap();
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let (image, recording) = (path("rotor.img"), path("rotor.parquet"));
    let mut simulate = Command::new(env!("CARGO_BIN_EXE_loadtwin"));
    simulate.args([
        "simulate",
        &stable,
        "--scenario",
        "constant",
        "-o",
        &recording,
    ]);
    assert!(simulate.status().unwrap().success());
    for (machine, grows) in [(&stable, false), (&unstable, true)] {
        let built = said(&["build", machine, "-o", &image, "--json"]);
        let replayed = said(&["replay", machine, &recording, "--json"]);
        assert_eq!(built["instability"].is_object(), grows, "{built}");
        for report in [built, replayed] {
            let note = report["stability_note"].as_str().unwrap_or_default();
            assert_eq!(note.contains("unstable at 88.0 rad/s"), grows, "{report}");
        }
    }
}
