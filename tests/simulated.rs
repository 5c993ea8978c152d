//! What the sensors of a described machine see.

use loadtwin::build::Sensors;
use loadtwin::machine::Machine;
use loadtwin::replay::Samples;
use loadtwin::simulate::{Scenario, Simulation};
use loadtwin_common::raw::RawSample;

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
    let mut scenario = Scenario::by_name(scenario).expect("a scenario of the simulation");
    scenario.duration_s = seconds;
    let folder = tempfile::tempdir().expect("a temporary directory");
    let path = folder.path().join("recording.parquet");
    Simulation::new(machine, &scenario, 7, None, &[])
        .expect("a machine that can be simulated")
        .write(&path, |_| ())
        .expect("it is written");
    let mut samples = Samples::open(machine, sensors, &path).expect("its own recording");
    let mut raw = Vec::new();
    while samples
        .next_block(|sample| raw.push(sample.raw))
        .expect("a whole recording")
    {}
    raw
}
