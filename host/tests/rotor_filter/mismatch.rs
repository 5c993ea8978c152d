//! Rotor filter with model error and with sensor faults: valid loads lie inside their band,
//! faulty sensors are flagged.

use loadtwin::image_build::{self, Sensors};
use loadtwin::machine::Machine;
use loadtwin_common::estimator::Estimator;
use loadtwin_common::image::Image;
use loadtwin_common::io::estimate::Estimate;
use loadtwin_common::io::fault::Fault;
use loadtwin_common::io::raw::RawSample;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::bound::{Recorded, drawn};
use crate::{machine, paper, record};
use loadtwin::simulate::RotorScenario;

/// Share of the samples that are valid, outside 3 sigma and off by more than 3 % of the force, and
/// of the valid ones inside 2 sigma.
#[derive(Clone, Copy, Debug, Default)]
pub struct Score {
    pub samples: f64,
    pub valid: f64,
    pub inside: f64,
    pub misleading: f64,
}

impl Score {
    pub fn push(&mut self, estimate: &Estimate, truth: &[f64], peak: f64) {
        for (load, truth) in estimate.loads.iter().zip(truth) {
            let (error, std) = ((f64::from(load.value) - truth).abs(), f64::from(load.std));
            self.samples += 1.0;
            if load.fault.is_none() {
                self.valid += 1.0;
                self.inside += f64::from(u8::from(error < 2.0 * std));
                self.misleading += f64::from(u8::from(error > 3.0 * std && error > 0.03 * peak));
            }
        }
    }
}

/// The machine's line over `raw`.
pub fn estimates(
    machine: &Machine,
    raw: &[RawSample],
    mut each: impl FnMut(usize, &Estimate, &Estimator<'_>),
) {
    let sensors = Sensors::choose(machine, None).unwrap();
    let payload = image_build::image(machine, &sensors).unwrap();
    let mut line = Estimator::try_build(Image::from_bytes(&payload).unwrap()).unwrap();
    for (k, raw) in raw.iter().enumerate() {
        let estimate = line.step(raw);
        each(k, &estimate, &line);
    }
}

/// A recording of `real`, `duration_s` long at the speed of `machine`.
pub fn recorded(machine: &Machine, real: &Machine, duration_s: f64) -> (Recorded, RotorScenario) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("rotor.parquet");
    let scenario = RotorScenario {
        duration_s,
        speeds_rad_s: [machine.rotor.as_ref().unwrap().speed_rad_s; 2],
        ..paper(1.0, 11)
    };
    record(real, scenario.clone(), &path);
    (Recorded::read(machine, &path), scenario)
}

/// The unbalances of `scenario` at sample `k`, and the larger one's size.
pub fn truth(machine: &Machine, scenario: &RotorScenario, k: usize) -> (Vec<f64>, f64) {
    let speed = scenario.speeds_rad_s[0];
    let angle = speed * k as f64 / machine.rate_hz;
    let mut peak = 0.0_f64;
    let forces = scenario.unbalances.iter().flat_map(|u| {
        let size = u.moment_kg_m * speed * speed;
        peak = peak.max(size);
        [
            size * (angle + u.phase_rad).cos(),
            size * (angle + u.phase_rad).sin(),
        ]
    });
    (forces.collect(), peak)
}

fn scored(machine: &Machine, real: &Machine, from_s: f64) -> (Score, f64, f64) {
    let (recorded, scenario) = recorded(machine, real, 3.0);
    let from = (from_s * machine.rate_hz) as usize;
    let (mut score, mut raised) = (Score::default(), 0.0);
    estimates(machine, &recorded.raw, |k, estimate, line| {
        let (truth, peak) = truth(machine, &scenario, k);
        if k >= from {
            score.push(estimate, &truth, peak);
            raised += f64::from(u8::from(line.rotor_level() > 0));
        }
    });
    (score, raised, recorded.raw.len() as f64)
}

/// A rotor with bearings 0.65 to 1.5 times as stiff as is described, a modulus off by up to 2 %,
/// and damping 0.6 to 1.6 times as large.
pub fn wrong(described: &Machine, seed: u64) -> Machine {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut real = described.clone();
    let rotor = real.rotor.as_mut().unwrap();
    for material in &mut rotor.materials {
        material.young_pa *= rng.random_range(0.98..1.02);
    }
    for bearing in &mut rotor.bearings {
        for k in bearing.stiffness_n_per_m.iter_mut().flatten().flatten() {
            *k *= rng.random_range(0.65..1.5);
        }
        for c in bearing.damping_n_s_per_m.iter_mut().flatten() {
            *c *= rng.random_range(0.6..1.6);
        }
    }
    real
}

/// `ROTORS`: how many rotors are drawn.
#[test]
fn forces_on_most_rotors_that_are_not_as_described_are_inside_their_band() {
    let count: u64 = std::env::var("ROTORS").map_or(4, |count| count.parse().unwrap());
    let mut inside = 0;
    for seed in 40..40 + count {
        let described = drawn(seed);
        let (score, raised, samples) = scored(&described, &wrong(&described, seed), 0.5);
        println!("seed {seed}: {score:?}, raised in {raised} of {samples}");
        assert!(raised > 0.0, "seed {seed}");
        inside += u64::from(score.misleading <= 0.01 * score.samples);
    }
    println!("inside their band: {inside} of {count}");
    assert!(4 * inside >= 3 * count, "{inside} of {count}");
}

/// A fault of these sensors from 1 s to 2 s: the score since, the least share of it in which one of them is flagged, and
/// whether all are used at the end.
fn failing(sensors: &[usize], change: impl Fn(i32, usize) -> i32) -> (Score, f64, bool) {
    let machine = machine();
    let (mut recorded, scenario) = recorded(&machine, &machine, 4.0);
    for (k, raw) in recorded.raw.iter_mut().enumerate() {
        for sensor in sensors.iter().filter(|_| (2000..4000).contains(&k)) {
            let word = change(raw.words[*sensor], k);
            raw.set_word(*sensor, word);
        }
    }
    let (mut score, mut flagged, mut sound) = (Score::default(), [0.0_f64; 4], true);
    estimates(&machine, &recorded.raw, |k, estimate, _| {
        let (truth, peak) = truth(&machine, &scenario, k);
        if k >= 2000 {
            score.push(estimate, &truth, peak);
        }
        for sensor in sensors {
            let fault = estimate.sensors[*sensor].fault;
            if (2200..4000).contains(&k) {
                flagged[*sensor] += f64::from(u8::from(!fault.is_none())) / 1800.0;
            }
            if k >= 7990 {
                sound &= fault.is_none();
            }
        }
    });
    let least = sensors.iter().map(|sensor| flagged[*sensor]);
    (score, least.fold(1.0, f64::min), sound)
}

/// A word of the failing sensor from the right one and the number of the sample.
type Change = fn(i32, usize) -> i32;

#[test]
fn a_sensor_that_fails_is_flagged_while_it_does_and_used_again_afterwards() {
    let faults: [(&str, Change); 4] = [
        ("stuck", |_, _| 20_000),
        ("sign turned", |word, _| -word),
        ("half the gain", |word, _| word / 2),
        ("offset", |word, _| word + 20_000),
    ];
    for (name, change) in faults {
        let (score, flagged, sound) = failing(&[0], change);
        println!("{name}: {score:?}, flagged {flagged:.3}");
        assert!(flagged > 0.95 && sound, "{name}: {flagged}");
        assert!(score.misleading <= 0.01 * score.samples, "{name}");
        assert!(score.valid > 0.9 * score.samples, "{name}");
    }
}

#[test]
fn two_sensors_that_fail_at_once_are_flagged_and_the_loads_stay_right() {
    for sensors in [[0, 1], [0, 2], [1, 2]] {
        for part in [0, 8] {
            let (score, flagged, sound) = failing(&sensors, |word, _| word * part / 10);
            println!("{sensors:?} times {part} / 10: {score:?}, flagged {flagged:.3}");
            assert!(flagged > 0.95 && sound, "{sensors:?} {part}: {flagged}");
            assert!(score.misleading <= 0.01 * score.samples, "{sensors:?}");
            assert!(score.valid > 0.9 * score.samples, "{sensors:?}");
        }
    }
}

#[test]
fn loads_that_most_sensors_contradict_are_valid_again_when_they_agree() {
    let (score, _, sound) = failing(&[0, 1, 2], |word, _| -word);
    println!("{score:?}");
    assert!(sound && score.misleading <= 0.01 * score.samples);
    // A second with the fault and at most two without: four levels, the last of them for half a second.
    assert!(score.valid > 0.1 * score.samples, "{score:?}");
}

#[test]
fn without_readings_the_loads_end_and_their_deviation_grows() {
    let machine = machine();
    let (mut recorded, _) = recorded(&machine, &machine, 2.0);
    for raw in &mut recorded.raw[2000..] {
        *raw = RawSample {
            tick: raw.tick,
            ..RawSample::default()
        };
    }
    let mut before = 0.0;
    estimates(&machine, &recorded.raw, |k, estimate, _| {
        let load = estimate.loads[0];
        match k {
            1999 => before = load.std,
            2000..=2099 => assert!(load.fault.is_none(), "{k}"),
            2101.. => assert_eq!(load.fault, Fault::NotValid, "{k}"),
            _ => {}
        }
        if k == 3999 {
            assert!(load.std > 5.0 * before, "{} {before}", load.std);
        }
    });
}
