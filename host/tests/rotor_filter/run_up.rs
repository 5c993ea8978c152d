//! Rotor in a run-up: forces of rotors that differ from their description lie inside their band or are not valid; those
//! of rotors as described lie inside and stay valid.

use loadtwin::image_build::Sensors;
use loadtwin::machine::Machine;
use loadtwin::replay::run_line;
use loadtwin::simulate::{AppliedUnbalance, RotorScenario};

use crate::bound::drawn;
use crate::mismatch::{Score, wrong};
use crate::record;

/// `ROTORS`: how many rotors are drawn.
const ROTORS: u64 = 4;

/// A rotor with an encoder, its critical speed within the run-up for most.
fn scheduled(seed: u64) -> Machine {
    let mut machine = drawn(seed);
    let encoder = "name = \"shaft\"\ncounts_per_turn = 2048\nbits = 16";
    machine.encoders.push(toml::from_str(encoder).unwrap());
    let rotor = machine.rotor.as_mut().unwrap();
    rotor.schedule_rad_s = Some([0.4, 1.4].map(|part| part * rotor.speed_rad_s));
    machine
}

/// Score of `machine` on a run-up of `real` over the speeds of its schedule.
fn scored(machine: &Machine, real: &Machine, seed: u64) -> Score {
    let rotor = machine.rotor.as_ref().unwrap();
    let unbalance = |(load, degrees): (&loadtwin::machine::RotorLoad, f64)| AppliedUnbalance {
        moment_kg_m: load.nominal_n / rotor.speed_rad_s.powi(2),
        phase_rad: degrees.to_radians(),
    };
    let scenario = RotorScenario {
        duration_s: 4.0,
        speeds_rad_s: rotor.schedule_rad_s.unwrap(),
        unbalances: rotor
            .loads
            .iter()
            .zip([70.0, 30.0])
            .map(unbalance)
            .collect(),
        noise: 1.0,
        seed,
    };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rotor.parquet");
    record(real, scenario, &path);
    let sensors = Sensors::choose(machine, None).unwrap();
    let highest = rotor.schedule_rad_s.unwrap()[1];
    let growth = (highest / rotor.speed_rad_s).powi(2);
    let peak = growth
        * (rotor.loads.iter())
            .map(|load| load.nominal_n)
            .fold(0.0, f64::max);
    let mut score = Score::default();
    run_line(machine, &sensors, &path, |sample, estimate, _, _| {
        score.push(estimate, sample.references, peak);
    })
    .unwrap();
    score
}

#[test]
fn forces_in_a_run_up_are_inside_their_band_whether_the_rotor_is_as_described_or_not() {
    let count = std::env::var("ROTORS").map_or(ROTORS, |count| count.parse().unwrap());
    let [mut rough, mut exact] = [Score::default(); 2];
    for seed in 60..60 + count {
        let machine = scheduled(seed);
        for (real, sum) in [
            (wrong(&machine, seed), &mut rough),
            (machine.clone(), &mut exact),
        ] {
            let score = scored(&machine, &real, seed);
            println!("seed {seed}: {score:?}");
            sum.samples += score.samples;
            sum.valid += score.valid;
            sum.inside += score.inside;
            sum.misleading += score.misleading;
        }
    }
    println!("not as described: {rough:?}\nas described: {exact:?}");
    assert!(rough.misleading <= 0.02 * rough.samples, "{rough:?}");
    assert!(rough.valid >= 0.2 * rough.samples, "{rough:?}");
    assert!(exact.misleading <= 0.005 * exact.samples, "{exact:?}");
    assert!(
        exact.inside >= 0.9 * exact.valid && exact.valid >= 0.9 * exact.samples,
        "{exact:?}"
    );
}
