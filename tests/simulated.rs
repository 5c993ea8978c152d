//! What the sensors of a described machine see.

use loadtwin::build::Sensors;
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
