//! Unit tests of the whiteness alarm of a rotor: levels of noise, established ones, rejected starts.

use super::*;
use crate::io::fault::Fault;

const LEVELS: u8 = 4;

/// Noise of variance 1/12 from a linear congruential generator.
struct NoiseModel(u32);

impl NoiseModel {
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (self.0 >> 8) as f32 / (1 << 24) as f32 - 0.5
    }
}

/// `windows` of four sensors that read noise and `more` of the sensor and the sample, until
/// the level changes; how many there were.
fn run(
    mismatch: &mut Mismatch,
    windows: u32,
    more: impl Fn(usize, u32) -> f32,
) -> (u32, Option<Change>) {
    run_at(mismatch, windows, 0.0, more)
}

/// As [`run`], at another speed.
fn run_at(
    mismatch: &mut Mismatch,
    windows: u32,
    place: f32,
    more: impl Fn(usize, u32) -> f32,
) -> (u32, Option<Change>) {
    let mut noise = NoiseModel(7);
    for k in 0..windows * u32::from(WINDOW) {
        let sensors = [0, 1, 2, 3].map(|sensor| {
            let innovation = noise.next() + more(sensor, k);
            SensorEstimate {
                innovation,
                innovation_variance: 1.0 / 12.0,
                nis: 12.0 * innovation * innovation,
                ..SensorEstimate::default()
            }
        });
        if let Some(change) = mismatch.push(&sensors, LEVELS, place) {
            return (k / u32::from(WINDOW) + 1, Some(change));
        }
    }
    (windows, None)
}

fn turning(k: u32) -> f32 {
    libm::sinf(0.12 * k as f32)
}

#[test]
fn noise_constants_and_one_bad_sensor_do_not_raise_the_level() {
    for constant in [0.0, 0.2, 50.0] {
        let mut mismatch = Mismatch::default();
        run(&mut mismatch, 4000, |_, _| constant);
        assert_eq!(mismatch.level(), 0, "{constant}");
    }
    let mut mismatch = Mismatch::default();
    run(&mut mismatch, 1000, |i, k| {
        if i == 2 { 50.0 * turning(k) } else { 0.0 }
    });
    assert_eq!(mismatch.level(), 0);
}

#[test]
fn a_large_error_of_the_model_raises_the_level_at_once_and_a_small_one_soon() {
    let mut mismatch = Mismatch::default();
    let found = run(&mut mismatch, 100, |_, k| 2.0 * turning(k));
    assert_eq!((found, mismatch.level()), ((2, Some(Change::Raised)), 2));
    let mut mismatch = Mismatch::default();
    let (windows, _) = run(&mut mismatch, 100, |_, k| 0.25 * turning(k));
    assert!(mismatch.level() == 1 && windows < STARTING + 8, "{windows}");
}

#[test]
fn lower_levels_are_tried_less_and_less_often_and_the_error_stays_allowed_for() {
    let mut mismatch = Mismatch::default();
    let mut lasted = [0; 4];
    for slot in &mut lasted {
        while mismatch.level() == 0 {
            run(&mut mismatch, 100, |_, k| 0.5 * turning(k));
        }
        assert_eq!(mismatch.level(), 1);
        *slot = run(&mut mismatch, 1000, |_, _| 0.0).0;
        assert!(mismatch.level() == 0 && mismatch.on_trial() && mismatch.allowed() == 1);
    }
    assert_eq!(lasted, [9, 17, 33, 65]);
}

#[test]
fn what_no_level_explains_is_said() {
    let mut mismatch = Mismatch::default();
    for _ in 0..3 {
        run(&mut mismatch, 5, |_, k| 10.0 * turning(k));
    }
    assert!(mismatch.level() == LEVELS - 1 && mismatch.is_contradicted());
}

#[test]
fn a_start_that_no_level_explains_is_rejected_until_another_speed_confirms_it() {
    let mut mismatch = Mismatch::default();
    for _ in 0..3 {
        run(&mut mismatch, 5, |_, k| 10.0 * turning(k));
    }
    assert!(mismatch.is_rejected());
    // Forces have taken up what the sensors err by.
    while mismatch.level() > 0 {
        run(&mut mismatch, 3000, |_, _| 0.0);
    }
    run(&mut mismatch, 3 * PROBATION, |_, _| 0.0);
    assert!(mismatch.is_rejected() && !mismatch.is_contradicted());
    run_at(&mut mismatch, PROBATION - 1, 2.0, |_, _| 0.0);
    assert!(mismatch.is_rejected());
    run_at(&mut mismatch, 1, 2.0, |_, _| 0.0);
    assert!(!mismatch.is_rejected());
}

/// A start at the highest level, which explains it.
fn unconfirmed() -> Mismatch {
    let mut mismatch = Mismatch::default();
    for _ in 0..2 {
        run(&mut mismatch, 20, |_, k| 2.0 * turning(k));
    }
    mismatch
}

/// The same, of which a lower level did not last, 32 windows after the start.
fn raised() -> Mismatch {
    let mut mismatch = unconfirmed();
    run(&mut mismatch, 40, |_, _| 0.0);
    run(&mut mismatch, 40, |_, k| 2.0 * turning(k));
    run(&mut mismatch, 20, |_, _| 0.0);
    assert_eq!(mismatch.level(), LEVELS - 1);
    mismatch
}

#[test]
fn a_start_at_the_highest_level_is_unconfirmed_and_one_below_is_not() {
    let mismatch = unconfirmed();
    assert!(mismatch.level() == LEVELS - 1 && mismatch.is_unconfirmed() && !mismatch.is_rejected());
    let mut mismatch = Mismatch::default();
    for _ in 0..2 {
        run(&mut mismatch, 20, |_, k| 0.25 * turning(k));
    }
    assert!(mismatch.level() > 0 && !mismatch.is_unconfirmed());
    // What was established was no start, and at another speed than that of the start the model errs.
    for (before, place) in [(100, 0.0), (4, 3.0)] {
        let mut mismatch = Mismatch::default();
        run(&mut mismatch, before, |_, _| 0.0);
        for _ in 0..2 {
            run_at(&mut mismatch, 100, place, |_, k| 2.0 * turning(k));
        }
        assert!(mismatch.level() == LEVELS - 1 && !mismatch.is_unconfirmed());
    }
}

#[test]
fn a_transient_that_dies_away_confirms_a_start_and_levels_raised_again_do_not() {
    for (mut mismatch, confirmed) in [(unconfirmed(), true), (raised(), false)] {
        while mismatch.level() > 0 {
            run(&mut mismatch, 3000, |_, _| 0.0);
        }
        run(&mut mismatch, 2 * PROBATION, |_, _| 0.0);
        assert_eq!(mismatch.is_unconfirmed(), !confirmed);
    }
}

#[test]
fn a_new_start_as_described_confirms_and_another_one_does_not() {
    let mut mismatch = raised().restarted();
    run(&mut mismatch, PROBATION - 1, |_, _| 0.0);
    assert!(mismatch.is_unconfirmed());
    run(&mut mismatch, 1, |_, _| 0.0);
    assert!(!mismatch.is_unconfirmed());
    let mut mismatch = raised().restarted();
    for _ in 0..2 {
        run(&mut mismatch, 20, |_, k| 0.25 * turning(k));
    }
    while mismatch.level() > 0 {
        run(&mut mismatch, 3000, |_, _| 0.0);
    }
    run(&mut mismatch, 2 * PROBATION, |_, _| 0.0);
    assert!(mismatch.is_unconfirmed());
    run_at(&mut mismatch, PROBATION, 2.0, |_, _| 0.0);
    assert!(!mismatch.is_unconfirmed());
}

#[test]
fn an_unconfirmed_start_is_tested_anew_at_a_reading_that_contradicts() {
    let mut mismatch = raised();
    assert!(mismatch.is_retest_due(true) && !mismatch.is_retest_due(false));
    mismatch = mismatch.restarted();
    run(&mut mismatch, 2 * PROBATION - 1, |_, k| 0.2 * turning(k));
    assert!(!mismatch.is_retest_due(true));
    let mut mismatch = raised();
    run_at(&mut mismatch, 1, 2.0, |_, _| 0.0);
    assert!(!mismatch.is_retest_due(true));
    assert!(!unconfirmed().is_retest_due(true));
}

#[test]
fn a_start_is_tested_after_its_first_windows() {
    let mut mismatch = Mismatch::default();
    run(&mut mismatch, STARTING, |_, _| 0.0);
    assert!(!mismatch.is_tested());
    run(&mut mismatch, 1, |_, _| 0.0);
    assert!(mismatch.is_tested());
}

#[test]
fn an_established_level_is_contradicted_until_it_stands_again() {
    let mut mismatch = Mismatch::default();
    run(&mut mismatch, PROBATION - 1, |_, _| 0.0);
    mismatch.contradict();
    assert!(!mismatch.is_contradicted());
    run(&mut mismatch, PROBATION, |_, _| 0.0);
    mismatch.contradict();
    assert!(mismatch.is_contradicted());
    while mismatch.level() == 0 {
        run(&mut mismatch, 100, |_, k| 2.0 * turning(k));
    }
    // The raised level explains the readings, and another one did before.
    run(&mut mismatch, SHORTEST, |_, _| 0.0);
    assert!(mismatch.is_contradicted());
    while mismatch.level() > 0 {
        run(&mut mismatch, 100, |_, _| 0.0);
        assert!(mismatch.is_contradicted());
    }
    run(&mut mismatch, PROBATION, |_, _| 0.0);
    assert!(!mismatch.is_contradicted() && mismatch.allowed() == 0);
}

#[test]
fn innovations_that_are_no_numbers_or_were_not_used_change_nothing() {
    let mut mismatch = Mismatch::default();
    run(&mut mismatch, 20, |_, _| f32::NAN);
    assert_eq!(mismatch.level(), 0);
    let refused = SensorEstimate {
        innovation: 1.0,
        fault: Fault::Erratic,
        ..SensorEstimate::default()
    };
    for _ in 0..20 * u32::from(WINDOW) {
        assert_eq!(mismatch.push(&[refused; 4], LEVELS, 0.0), None);
    }
}
