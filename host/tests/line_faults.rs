//! Sensor faults in raw samples of two inertias under a steady torque, from words to estimates:
//! missing, saturated and stuck words are flagged and the torque stays within 10 %; lost samples,
//! gaps and wraps of the encoder are bridged; no raw sample gives a number that is not finite.

use std::path::Path;

use loadtwin::image_build::{self, Sensors};
use loadtwin::machine::Machine;
use loadtwin_common::estimator::Estimator;
use loadtwin_common::image::Image;
use loadtwin_common::io::estimate::Estimate;
use loadtwin_common::io::fault::Fault;
use loadtwin_common::io::raw::RawSample;
use proptest::prelude::*;
use proptest::test_runner::RngSeed;

const NOMINAL: f64 = 300e3;
const RATIO: f64 = 60.0;
const COUNTS: f64 = 4096.0;
const RATE: f64 = 500.0;
/// One turn of the carrier in five seconds.
const SPEED: f64 = std::f64::consts::TAU / 5.0;

fn payload() -> Vec<u8> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/two_inertias.toml");
    let machine = Machine::load(&path).unwrap();
    image_build::image(&machine, &Sensors::choose(&machine, None).unwrap()).unwrap()
}

/// The raw sample `tick` of a machine that turns steadily under nominal torque.
fn steady(tick: u32) -> RawSample {
    let angle = SPEED * f64::from(tick) / RATE;
    let mut raw = RawSample {
        tick,
        ..RawSample::default()
    };
    // 100 micrometre a metre at nominal torque, 1e-9 a count, a little dither.
    let dither = [0, 300, -200, 100, -400, 200][tick as usize % 6];
    raw.set_word(0, 100_000 + dither);
    // Its response varies by one half over the carrier angle, counted from the pulse at angle 1.
    let map = 1.0 + 0.5 * (angle + 1.0).cos();
    raw.set_word(1, (100_000.0 * map) as i32 - dither);
    let count = |angle: f64| (angle * RATIO * COUNTS / std::f64::consts::TAU).floor() as i64 as u32;
    raw.set_encoder(0, count(angle));
    let turns = (angle / std::f64::consts::TAU).floor();
    let before = ((angle - SPEED / RATE) / std::f64::consts::TAU).floor();
    if turns > before {
        raw.index = Some(count(turns * std::f64::consts::TAU));
    }
    raw
}

fn main_torque(estimate: &Estimate) -> f64 {
    f64::from(estimate.loads[0].value)
}

/// Runs `samples` samples through the line, each changed by `change`.
fn run(
    line: &mut Estimator<'_>,
    from: u32,
    samples: u32,
    change: impl Fn(&mut RawSample),
) -> Vec<Estimate> {
    (from..from + samples)
        .map(|tick| {
            let mut raw = steady(tick);
            change(&mut raw);
            line.step(&raw)
        })
        .collect()
}

fn line(payload: &[u8]) -> Estimator<'_> {
    Estimator::try_build(Image::from_bytes(payload).unwrap()).unwrap()
}

#[test]
fn a_steady_torque_is_found_and_valid() {
    let payload = payload();
    let mut line = line(&payload);
    let last = run(&mut line, 0, 5000, |_| ()).pop().unwrap();
    assert!(
        (main_torque(&last) / NOMINAL - 1.0).abs() < 0.02,
        "{last:?}"
    );
    assert_eq!(last.loads[0].fault, Fault::None);
    assert!(last.homed);
}

#[test]
fn before_the_first_index_pulse_the_estimate_says_that_it_is_not_homed() {
    let payload = payload();
    let mut line = line(&payload);
    let estimates = run(&mut line, 1, 2000, |_| ());
    let last = estimates.last().unwrap();
    assert!(!last.homed);
    assert_eq!(last.loads[0].fault, Fault::NotHomed);
    // The constant gauge alone is enough for the torque.
    assert!((main_torque(last) / NOMINAL - 1.0).abs() < 0.1, "{last:?}");
}

/// A fault of channel 0 for 200 samples: flagged, survived, forgotten.
fn survives(change: impl Fn(&mut RawSample), expected: Fault, patience: usize) {
    let payload = payload();
    let mut line = line(&payload);
    let before = run(&mut line, 0, 5000, |_| ()).pop().unwrap();
    let during = run(&mut line, 5000, 200, &change);
    assert_eq!(during[patience].sensors[0].fault, expected);
    assert!(during[patience].loads[0].std > before.loads[0].std);
    for estimate in &during {
        assert!(
            (main_torque(estimate) / NOMINAL - 1.0).abs() < 0.1,
            "{estimate:?}"
        );
    }
    let after = run(&mut line, 5200, 500, |_| ());
    assert!(
        after[5..]
            .iter()
            .all(|e| e.sensors.iter().all(|s| s.fault.is_none()))
    );
}

#[test]
fn a_missing_word_is_survived() {
    survives(|raw| raw.valid &= !1, Fault::Missing, 0);
}

#[test]
fn a_saturated_word_is_survived() {
    survives(|raw| raw.words[0] = 8_388_607, Fault::SaturatedHigh, 0);
    survives(|raw| raw.words[0] = -8_388_608, Fault::SaturatedLow, 0);
}

#[test]
fn a_stuck_word_is_survived() {
    survives(|raw| raw.words[0] = 100_000, Fault::Stuck, 10);
}

#[test]
fn lost_samples_are_bridged() {
    let payload = payload();
    let mut line = line(&payload);
    run(&mut line, 0, 5000, |_| ());
    let estimate = line.step(&steady(5040));
    assert_eq!(estimate.lost, 40);
    assert!(
        (main_torque(&estimate) / NOMINAL - 1.0).abs() < 0.05,
        "{estimate:?}"
    );
}

#[test]
fn after_a_long_gap_the_estimate_starts_again() {
    let payload = payload();
    let mut line = line(&payload);
    run(&mut line, 0, 5000, |_| ());
    assert_eq!(line.step(&steady(10_000)).loads[0].fault, Fault::NotValid);
    let last = run(&mut line, 10_001, 3000, |_| ()).pop().unwrap();
    assert!(
        (main_torque(&last) / NOMINAL - 1.0).abs() < 0.02,
        "{last:?}"
    );
}

#[test]
fn the_encoder_may_wrap() {
    let payload = payload();
    let mut line = line(&payload);
    let far = |raw: &mut RawSample| {
        let offset = u32::MAX - 100_000;
        raw.encoders[0] = raw.encoders[0].wrapping_add(offset);
        raw.index = raw.index.map(|count| count.wrapping_add(offset));
    };
    let last = run(&mut line, 0, 5000, far).pop().unwrap();
    assert!(
        (main_torque(&last) / NOMINAL - 1.0).abs() < 0.02,
        "{last:?}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, rng_seed: RngSeed::Fixed(1), ..ProptestConfig::default() })]
    #[test]
    fn no_raw_sample_makes_a_number_that_is_not_finite(
        samples in proptest::collection::vec(
            (any::<u32>(), any::<u16>(), any::<[i32; 8]>(), any::<[u32; 2]>(), any::<Option<u32>>()), 1..60,
        )
    ) {
        let payload = payload();
        let mut line = line(&payload);
        for (i, (tick, valid, words, encoders, index)) in samples.into_iter().enumerate() {
            // Most ticks in order, so that the filter is not restarted all the time.
            let tick = if tick % 8 == 0 { tick } else { i as u32 };
            let estimate = line.step(&RawSample { tick, valid, words, encoders, index });
            for load in &estimate.loads {
                prop_assert!(load.value.is_finite() && load.std.is_finite(), "{estimate:?}");
            }
            for sensor in &estimate.sensors {
                prop_assert!(sensor.innovation.is_finite() && sensor.nis.is_finite());
            }
        }
    }
}
