//! Raw samples of a described machine: rotors, bearings and drivetrains from a scenario of
//! `loadtwin::simulate`; drives as sines and steps, whatever the scenario.

use std::f64::consts::TAU;

use loadtwin::image_build::Sensors;
use loadtwin::machine::{Kind, Machine};
use loadtwin::replay::Samples;
use loadtwin::simulate::{
    BearingScenario, BearingSimulation, RotorScenario, RotorSimulation, Scenario, Simulation,
};
use loadtwin_common::io::raw::RawSample;

/// Draws every recording.
const SEED: u64 = 7;

/// The bearing that `examples/bearing/calibration.toml` belongs to.
const CALIBRATED: u64 = 101;

/// `seconds` of what the board of a machine would see in a scenario of the simulation.
///
/// # Panics
/// Where the machine cannot be simulated.
pub fn samples(
    machine: &Machine,
    sensors: &Sensors,
    scenario: &str,
    seconds: f64,
) -> Vec<RawSample> {
    if let Some(Kind::Drive(_)) = machine.kind() {
        return drive(machine, sensors, seconds);
    }
    let folder = tempfile::tempdir().expect("a temporary directory");
    let path = folder.path().join("recording.parquet");
    match machine.kind() {
        Some(Kind::Rotor(rotor)) => {
            let scenario = RotorScenario::by_name(scenario, rotor, SEED, Some(seconds))
                .expect("a scenario of rotors");
            RotorSimulation::new(machine, rotor, scenario)
                .expect("a rotor that can be simulated")
                .write(&path, |_| ())
        }
        Some(Kind::Bearing(bearing)) => {
            let (scenario, _) = BearingScenario::by_name(scenario).expect("a scenario of bearings");
            let individual = Some(CALIBRATED);
            BearingSimulation::new(machine, bearing, scenario, seconds, SEED, individual, &[])
                .expect("a bearing that can be simulated")
                .write(&path, |_| ())
        }
        _ => {
            let mut scenario = Scenario::by_name(scenario).expect("a scenario of drivetrains");
            scenario.duration_s = seconds;
            Simulation::new(machine, &scenario, SEED, None, &[])
                .expect("a machine that can be simulated")
                .write(&path, |_| ())
        }
    }
    .expect("it is written");
    let mut samples = Samples::open(machine, sensors, &path).expect("its own recording");
    let mut raw = Vec::new();
    while samples
        .next_block(|sample| raw.push(sample.raw))
        .expect("a whole recording")
    {}
    raw
}

/// Turns of the shaft of a drive in either direction.
const TURNS: f64 = 1.5;

/// A shaft that is turned to and fro, slower and faster, against a load that steps; counts of an
/// encoder of 8192, and a drive that is not balanced: whatever is unknown of it is a load.
fn drive(machine: &Machine, sensors: &Sensors, seconds: f64) -> Vec<RawSample> {
    let samples = (seconds * machine.rate_hz) as u32;
    let at = |tick: u32| {
        let t = f64::from(tick) / machine.rate_hz;
        let swing = TURNS * TAU * (1.7 * t).sin() * (0.4 * t).cos();
        let mut raw = RawSample {
            tick,
            ..RawSample::default()
        };
        for (k, channel) in sensors.channels.iter().enumerate() {
            let step = if (t * 0.8).fract() > 0.5 { 0.3 } else { -0.2 };
            let ripple = 0.02 * (311.0 * t + k as f64).sin();
            let value = step * (1.0 + k as f64) + (1.7 * t).cos() + ripple;
            raw.set_word(k, channel.word(value));
        }
        for k in 0..sensors.encoders.len() {
            raw.set_encoder(k, (swing / TAU * 8192.0).round() as i64 as u32);
        }
        raw
    };
    (0..samples).map(at).collect()
}
