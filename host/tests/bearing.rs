//! Estimator of the example's wheel bearing on recordings simulated for the individual that it is
//! calibrated for: moments from an unknown start (within 4 and 9 % of their range), standing wheel,
//! dead gauge, lower errors than both algorithms of the paper. Calibration of another individual.

#[path = "web/appearance.rs"]
mod appearance;
#[path = "web/browser.rs"]
mod browser;

use std::path::{Path, PathBuf};
use std::process::Command;

use loadtwin::bearing::Calibration;
use loadtwin::image_build::Sensors;
use loadtwin::machine::{Kind, Machine};
use loadtwin::replay::{self, Baselines, Figures};
use loadtwin::simulate::{BearingEffect, BearingScenario, BearingSimulation};
use loadtwin_common::bearing::BearingEstimator;
use loadtwin_common::io::fault::Fault;
use loadtwin_common::io::raw::RawSample;

/// The individual that the example is calibrated for.
const CALIBRATED: u64 = 101;

fn example() -> Machine {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/bearing/calibrated.toml");
    Machine::load(&path).unwrap()
}

fn record(
    machine: &Machine,
    scenario: &str,
    duration_s: f64,
    effects: &[BearingEffect],
    folder: &Path,
) -> PathBuf {
    let Some(Kind::Bearing(bearing)) = machine.kind() else {
        unreachable!("the example is a bearing");
    };
    let (which, _) = BearingScenario::by_name(scenario).unwrap();
    let path = folder.join(format!("{scenario}.parquet"));
    BearingSimulation::new(
        machine,
        bearing,
        which,
        duration_s,
        7,
        Some(CALIBRATED),
        effects,
    )
    .unwrap()
    .write(&path, |_| ())
    .unwrap();
    path
}

#[test]
fn moments_are_found_from_an_unknown_start() {
    let folder = tempfile::tempdir().unwrap();
    let machine = example();
    let path = record(&machine, "lc1", 16.0, &[], folder.path());
    let sensors = Sensors::choose(&machine, None).unwrap();
    let mut figures = Figures::new(&machine);
    let mut valid = 0_u64;
    replay::run(&machine, &sensors, &path, |sample, estimate, _| {
        figures.push(sample, estimate);
        valid += u64::from(estimate.loads[3].fault.is_none());
    })
    .unwrap();
    assert!(valid > figures.samples() / 4, "{valid}");
    for (name, bound) in [("Mx", 4.0), ("Mz", 9.0)] {
        let (_, load) = figures.loads().find(|(load, _)| *load == name).unwrap();
        let rmse = load.rmse_percent.unwrap();
        println!("{name}: {rmse:.2} % of its range");
        assert!(rmse < bound, "{name} {rmse}");
    }
}

/// However many jobs a sample has to do.
#[test]
fn every_block_is_taken_in_at_any_rate() {
    let mut machine = example();
    let bearing = machine.bearing.clone().unwrap();
    let calibration = loadtwin::bearing::calibration(&machine, &bearing).unwrap();
    for rate_hz in [400.0, 700.0, 1000.0, 2000.0] {
        machine.rate_hz = rate_hz;
        let sensors = Sensors::choose(&machine, None).unwrap();
        let model = loadtwin::bearing::model(&machine, &bearing, &sensors, &calibration).unwrap();
        let filter = BearingEstimator::try_build(model, rate_hz as f32).unwrap();
        let mut state = filter.start();
        state.set_known_loads([0.0; 5]);
        let mut taken_in = 0;
        for tick in 0..rate_hz as u32 {
            let mut raw = RawSample {
                tick,
                ..RawSample::default()
            };
            (0..4).for_each(|g| raw.set_word(g, 10 * (tick % 7) as i32));
            let turns = 15.0 * f64::from(tick) / rate_hz;
            raw.set_encoder(0, (turns * machine.encoders[0].counts_per_turn) as u32);
            filter.step(&mut state, &raw);
            taken_in += u32::from(state.updated().is_some());
        }
        // The first ones determine the speed, at 400 Hz in 28 samples; the last is on its way.
        assert!((90..=99).contains(&taken_in), "{taken_in} at {rate_hz} Hz");
    }
}

#[test]
fn a_standing_wheel_has_no_valid_load() {
    let folder = tempfile::tempdir().unwrap();
    let machine = example();
    let path = record(&machine, "stop-and-go", 40.0, &[], folder.path());
    let sensors = Sensors::choose(&machine, None).unwrap();
    let (mut last, mut still, mut moved) = (None, 0_u32, 0_u64);
    replay::run(&machine, &sensors, &path, |sample, estimate, _| {
        let count = sample.raw.encoders[0];
        still = if last == Some(count) { still + 1 } else { 0 };
        last = Some(count);
        let valid = estimate.loads.iter().any(|load| load.fault == Fault::None);
        moved += u64::from(valid);
        // A tenth of a second without a count.
        assert!(still < 200 || !valid, "a load at {} s", sample.t);
    })
    .unwrap();
    assert!(moved > 0, "no load was ever valid");
}

#[test]
fn a_dead_gauge_is_named_within_two_seconds() {
    const DEAD: usize = 2;
    const SINCE_S: f64 = 5.0;
    let folder = tempfile::tempdir().unwrap();
    let machine = example();
    let dead = BearingEffect::DeadGauge(DEAD, SINCE_S);
    let path = record(&machine, "lc1", 8.0, &[dead], folder.path());
    let sensors = Sensors::choose(&machine, None).unwrap();
    let mut named = None;
    replay::run(&machine, &sensors, &path, |sample, estimate, _| {
        for (g, sensor) in estimate.sensors.iter().enumerate().take(4) {
            match sensor.fault {
                Fault::None => {}
                Fault::Stuck | Fault::Dead if g == DEAD && sample.t > SINCE_S => {
                    named.get_or_insert(sample.t);
                }
                // A gauge that falls silent is first off by what it read before.
                Fault::Offset if g == DEAD && sample.t > SINCE_S && named.is_none() => {}
                fault => panic!("gauge {g} is {fault:?} at {} s", sample.t),
            }
        }
    })
    .unwrap();
    let after = named.expect("named at all") - SINCE_S;
    println!("named after {after:.2} s");
    assert!(after < 2.0, "{after} s");
}

#[test]
fn the_filter_is_better_than_both_algorithms_of_the_paper() {
    let folder = tempfile::tempdir().unwrap();
    let machine = example();
    let path = record(&machine, "lc1", 16.0, &[], folder.path());
    let sensors = Sensors::choose(&machine, None).unwrap();
    let mut baselines = Baselines::try_new(&machine).unwrap();
    replay::run(&machine, &sensors, &path, |sample, estimate, _| {
        baselines.push(sample, estimate);
    })
    .unwrap();
    let figures = baselines.figures();
    let rmse = |method: &str, load: &str| figures[method][load]["whole"].as_f64().unwrap();
    for load in ["Fx", "Fz", "Mx", "Mz"] {
        let ours = rmse("joint filter", load);
        for method in ["regression", "cascade"] {
            let theirs = rmse(method, load);
            println!("{load}: {ours:.2} %, {method} {theirs:.2} %");
            assert!(ours < theirs, "{load}");
        }
    }
}

#[test]
fn baselines_are_refused_on_another_machine() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/rotor/machine.toml");
    let machine = Machine::load(&path).unwrap();
    let refused = Baselines::try_new(&machine).err().unwrap().to_string();
    assert!(refused.contains("allowed: a bearing"), "{refused}");
}

/// With its phases lost once for a moment, most of a recording on the rig still counts: a mirror
/// image is distinguished from the truth at once where the loads are known.
#[test]
fn a_bearing_is_calibrated_from_a_part_of_the_usual_recording() {
    const INDIVIDUAL: &str = "1";
    let folder = tempfile::tempdir().unwrap();
    let machine = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/bearing/machine.toml");
    let (rig, out) = (
        folder.path().join("rig.parquet"),
        folder.path().join("out.toml"),
    );
    let run = |arguments: &[&str]| {
        let done = Command::new(env!("CARGO_BIN_EXE_loadtwin"))
            .args(arguments)
            .output()
            .unwrap();
        assert!(done.status.success(), "{done:?}");
    };
    let [machine, rig, out] = [&machine, &rig, &out].map(|path| path.to_str().unwrap());
    run(&[
        "simulate",
        machine,
        "--scenario",
        "calibration",
        "--seed",
        INDIVIDUAL,
        "--individual",
        INDIVIDUAL,
        "--duration-s",
        "40",
        "-o",
        rig,
    ]);
    let page = folder.path().join("page.html");
    let report = page.to_str().unwrap();
    run(&["calibrate", machine, rig, "-o", out, "--report", report]);
    let mut browser = browser::Browser::open("about:blank");
    appearance::check_report(&mut browser, &page, "calibrate-bearing");
    let found = Calibration::read(Path::new(out), 4).unwrap();
    // Of a part whose stiffness is within some percent of the described one.
    assert!(found.physical.stiffness.abs() < 0.2, "{:?}", found.physical);
}
