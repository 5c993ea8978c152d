//! `loadtwin calibrate --static`: bridges with and without hysteresis, cubic and creep; intervals,
//! tables, recordings, refusals, and the description that is written.

mod bridge;
mod certificate;
mod files;

use bridge::{Bridge, LARGEST, MACHINE, SENSITIVITY};
use loadtwin::machine::Machine;
use loadtwin::static_calibration::{Finding, Start, StaticCalibration, Term, fit};

fn machine() -> Machine {
    Machine::load(std::path::Path::new(MACHINE)).unwrap()
}

fn calibrated(machine: &Machine, bridge: Bridge, seed: u64) -> StaticCalibration {
    fit(machine, &bridge.steps(machine, seed))
        .unwrap()
        .remove(0)
}

fn found<'a>(calibration: &'a StaticCalibration, term: &str) -> Option<&'a Finding> {
    calibration
        .found
        .iter()
        .find(|finding| finding.term.name() == term)
}

/// 95 % interval of a rate of `k` in `n`.
///
/// Source: Wilson 1927, Probable inference.
fn wilson(k: u32, n: u32) -> [f64; 2] {
    let (n, p, z2) = (f64::from(n), f64::from(k) / f64::from(n), 1.96_f64.powi(2));
    let half = (z2 * (p * (1.0 - p) / n + z2 / (4.0 * n * n))).sqrt();
    [-half, half].map(|half| (p + z2 / (2.0 * n) + half) / (1.0 + z2 / n))
}

/// In how many bridges of `seeds` something is so, and how many there are.
fn count(seeds: std::ops::Range<u64>, of: impl Fn(u64) -> bool + Sync) -> (u32, u32) {
    use rayon::prelude::*;
    let n = seeds.clone().count() as u32;
    let k = seeds.into_par_iter().filter(|seed| of(*seed)).count() as u32;
    (k, n)
}

/// So many seeds from `first` on in `tests/run long`, which sets `LOADTWIN_BRIDGES`; else a third.
fn seeds(first: u64, long: u64) -> std::ops::Range<u64> {
    let part = std::env::var_os("LOADTWIN_BRIDGES").map_or(3, |_| 1);
    first..first + long / part
}

const FAULTY: Bridge = Bridge {
    cubic: 0.05,
    hysteresis: 0.1,
    ..Bridge::CLEAN
};

/// Three runs of ten loads up and down; readings to 0.002 %, for loads of both signs to 0.005 %.
#[test]
fn hysteresis_and_cubic_are_found_within_a_fifth_of_their_size() {
    let machine = machine();
    let both_signs = Bridge {
        noise: 0.005,
        both_signs: true,
        ..FAULTY
    };
    // Relays of play bend the characteristic at its ends, so that the cubic is no longer 0.05 %.
    let play = Bridge {
        has_play: true,
        cubic: 0.0,
        ..FAULTY
    };
    for (name, bridge, term, size) in [
        ("one sign", FAULTY, "hysteresis", 0.1),
        ("one sign", FAULTY, "cubic", 0.05),
        ("both signs", both_signs, "hysteresis", 0.1),
        ("both signs", both_signs, "cubic", 0.05),
        ("play", play, "hysteresis", 0.1),
    ] {
        let (k, n) = count(10_000..10_200, |seed| {
            let calibration = calibrated(&machine, bridge, seed);
            let percent = found(&calibration, term).map(|f| f.percent.value);
            percent.is_some_and(|percent| (percent / size - 1.0).abs() < 0.2)
        });
        let [low, high] = wilson(k, n);
        println!("{name}: {term} {k} of {n}: {low:.3} to {high:.3}");
        assert!(low > 0.9, "{name}: {term} {k} of {n}");
    }
}

/// Loops whose mean curve lies below their chord: while the load rises they look as the first loading
/// of a virgin structure.
#[test]
fn sagging_loops_keep_the_start_of_preloaded_structures() {
    let machine = machine();
    for (quadratic, cubic) in [(-0.05, 0.0), (-0.2, 0.0), (0.0, -0.05), (0.0, -0.2)] {
        let bridge = Bridge {
            quadratic,
            cubic,
            ..FAULTY
        };
        let (k, n) = count(30_000..30_100, |seed| {
            let calibration = calibrated(&machine, bridge, seed);
            let Some(hysteresis) = found(&calibration, "hysteresis") else {
                return false;
            };
            let is_preloaded = matches!(
                hysteresis.term,
                Term::Hysteresis {
                    start: Start::Preloaded,
                    ..
                }
            );
            let certificate = &calibration.certificate;
            is_preloaded
                && (hysteresis.percent.value / 0.1 - 1.0).abs() < 0.2
                && (certificate.reversibility.unwrap() / 0.1 - 1.0).abs() < 0.2
                && certificate.repeatability.unwrap() < 0.05
        });
        println!("quadratic {quadratic}, cubic {cubic}: {k} of {n}");
        assert!(
            f64::from(k) >= 0.97 * f64::from(n),
            "quadratic {quadratic}, cubic {cubic}: {k} of {n}"
        );
    }
}

#[test]
fn clean_bridges_show_nothing() {
    let machine = machine();
    for (name, bridge) in [
        ("one sign", Bridge::CLEAN),
        (
            "noisy",
            Bridge {
                noise: 0.02,
                ..Bridge::CLEAN
            },
        ),
        (
            "both signs",
            Bridge {
                noise: 0.005,
                both_signs: true,
                ..Bridge::CLEAN
            },
        ),
        (
            "one run",
            Bridge {
                runs: 1,
                steps: 5,
                ..Bridge::CLEAN
            },
        ),
    ] {
        let (k, n) = count(seeds(20_000, 1000), |seed| {
            calibrated(&machine, bridge, seed).found.is_empty()
        });
        let [low, high] = wilson(k, n);
        println!("{name}: nothing in {k} of {n}: {low:.3} to {high:.3}");
        assert!(f64::from(k) >= 0.98 * f64::from(n), "{name}: {k} of {n}");
    }
}

#[test]
fn intervals_hold_the_truth() {
    let machine = machine();
    let bridge = Bridge {
        noise: 0.005,
        both_signs: true,
        ..FAULTY
    };
    let holds = |interval: [f64; 2], truth: f64| interval[0] <= truth && truth <= interval[1];
    let of_term = |term: &'static str, truth: f64| {
        let machine = &machine;
        move |seed| {
            let calibration = calibrated(machine, bridge, seed);
            found(&calibration, term).is_some_and(|f| holds(f.percent.interval(), truth))
        }
    };
    let sensitivity = |seed| {
        let calibration = calibrated(
            &machine,
            Bridge {
                runs: 5,
                ..Bridge::CLEAN
            },
            seed,
        );
        holds(calibration.sensitivity.interval(), SENSITIVITY)
    };
    for (name, (k, n)) in [
        (
            "hysteresis",
            count(seeds(10_000, 400), of_term("hysteresis", 0.1)),
        ),
        ("cubic", count(seeds(10_000, 400), of_term("cubic", 0.05))),
        ("sensitivity", count(seeds(10_000, 400), sensitivity)),
    ] {
        let [low, high] = wilson(k, n);
        println!("{name}: {k} of {n}: {low:.3} to {high:.3}");
        assert!(
            (0.9..=0.995).contains(&(f64::from(k) / f64::from(n))),
            "{name}: {k} of {n}"
        );
    }
}

/// The figures of the certificate are those of the readings, by their definitions.
#[test]
fn certificate_of_a_bridge_without_noise() {
    let machine = machine();
    let bridge = Bridge {
        noise: 0.0,
        runs: 2,
        hysteresis: 0.12,
        ..FAULTY
    };
    let calibration = calibrated(&machine, bridge, 3);
    let certificate = &calibration.certificate;
    // A cubic c x^3 is 2 c / (3 sqrt 3) above or below its chord; the best line halves that, and
    // the loop adds up to half its width.
    assert!(
        certificate
            .linearity
            .is_some_and(|l| (0.008..0.08).contains(&l)),
        "{certificate:?}"
    );
    let reversibility = certificate.reversibility.unwrap();
    assert!((reversibility / 0.12 - 1.0).abs() < 0.1, "{certificate:?}");
    assert!(certificate.repeatability.unwrap() < 0.05, "{certificate:?}");
    assert!(certificate.combined >= certificate.linearity);
    assert_eq!(certificate.class(), Some(0.2), "{certificate:?}");
    assert!((calibration.range[1] - LARGEST).abs() < 1e-9);
}

/// A brake at the other end of the shaft loads it as the motor does.
#[test]
fn a_load_at_either_end_gives_the_sensitivity() {
    let machine = machine();
    let mut steps = Bridge::CLEAN.steps(&machine, 1);
    for load in ["motor_torque", "brake_torque"] {
        let loads = &machine.drivetrain.as_ref().unwrap().loads;
        steps.load = loads.iter().position(|l| l.name == load).unwrap();
        let calibration = fit(&machine, &steps).unwrap().remove(0);
        let sensitivity = calibration.sensitivity.value;
        assert!(
            (sensitivity / SENSITIVITY - 1.0).abs() < 1e-3,
            "{load}: {sensitivity}"
        );
    }
}
