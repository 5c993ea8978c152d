//! Unit tests of the drive's estimator: unknown load through friction and reversals, delayed
//! drive signal, homing, gaps, refused parameters.

extern crate std;

use super::*;
use crate::drive::term::{Direction, Factor, Term};
use crate::io::measurement::EncoderScaling;
use crate::load_signal::LoadSignal;
use crate::signal::phase::PhaseStep;

const RATE_HZ: f32 = 1000.0;
const COUNT: f32 = 1e-5;
const LSB: f32 = 1e-3;

fn signal(noise_std: f32) -> Signal {
    Signal {
        converter: AdcScaling {
            zero: 0,
            gain: LSB,
            lowest: i32::MIN,
            highest: i32::MAX,
            stuck_after: 0,
        },
        noise_std,
        delay: 0.0,
    }
}

/// An axis of 2 kg with drag and dry friction.
fn model() -> DriveModel<'static> {
    let mut model = DriveModel {
        sample_s: 1.0 / RATE_HZ,
        loads: Vec::new(),
        unit: "N".try_into().unwrap(),
        drive: Some(signal(0.05)),
        position: Some(PositionSensor {
            counter: EncoderScaling {
                step: PhaseStep(0),
                bits: 16,
            },
            count: COUNT,
            at_zero: 0.0,
            at_pulse: None,
            noise_std: 0.3 * COUNT,
            delay: 0.0,
        }),
        speed: None,
        known: Vec::new(),
        offset: 0.5,
        inertia: 2.0,
        drag: 3.0,
        // Motion to 40 Hz, load to 20 Hz.
        jerk_density: 2.2,
        load_variance: 1.5e-4,
        model_std: 0.1,
        initial_std: [1e-4, 2.0, 300.0, 100.0],
        directions: Vec::new(),
        terms: Vec::new(),
    };
    let _ = model.loads.push(LoadSignal {
        name: "load".try_into().unwrap(),
        full_scale: 1000.0,
        valid_std: 90.0,
    });
    let _ = model.directions.push(Direction::Sliding { distance: 1e-4 });
    let _ = model.terms.push(Term {
        coefficient: 4.0,
        factor: Factor::One,
        direction: Some(0),
    });
    model
}

/// Position, speed and acceleration of a sine of 0.5 m at 0.5 Hz.
fn motion(t: f32) -> [f32; 3] {
    let w = core::f32::consts::PI;
    let (s, c) = (libm::sinf(w * t), libm::cosf(w * t));
    [0.5 * s, 0.5 * w * c, -0.5 * w * w * s]
}

fn drive(t: f32, load: f32) -> f32 {
    let [_, v, a] = motion(t);
    0.5 + 2.0 * a + 3.0 * v + 4.0 * libm::copysignf(1.0, v) + load
}

fn sample(k: u32, position: f32, drive: f32) -> RawSample {
    let mut raw = RawSample {
        tick: k,
        ..RawSample::default()
    };
    raw.set_word(0, libm::rintf(drive / LSB) as i32);
    raw.set_encoder(0, (libm::rintf(position / COUNT) as i32 as u32) & 0xffff);
    raw
}

/// Errors of the load after the first second.
fn errors(model: DriveModel<'_>, load: impl Fn(f32) -> f32) -> std::vec::Vec<f32> {
    let estimator = DriveEstimator::try_build(model).unwrap();
    let mut state = estimator.start();
    let mut errors = std::vec::Vec::new();
    for k in 0..6000 {
        let t = k as f32 / RATE_HZ;
        let raw = sample(k, motion(t)[0], drive(t, load(t)));
        let estimate = estimator.step(&mut state, &raw);
        if t > 1.0 {
            errors.push(estimate.loads[0].value - load(t));
        }
    }
    errors
}

fn rms(errors: &[f32]) -> f32 {
    libm::sqrtf(errors.iter().map(|e| e * e).sum::<f32>() / errors.len() as f32)
}

/// A load that steps while the axis moves on through reversals, over a counter of 16 bits that
/// wraps.
#[test]
fn the_unknown_load_is_found_through_friction_and_reversals() {
    let load = |t: f32| if t > 3.3 { 20.0 } else { 0.0 };
    let with = rms(&errors(model(), load));
    let mut without = model();
    without.terms.clear();
    let without = rms(&errors(without, load));
    assert!(with < 1.5, "{with}");
    assert!(without > 3.5 && without > 3.0 * with, "{without}");
}

/// What is estimated where the drive is no input is the drive itself.
#[test]
fn a_drive_that_is_not_measured_is_estimated_from_motion_and_known_load() {
    let mut model = model();
    model.drive = None;
    model.known.push(signal(0.1)).unwrap();
    let estimator = DriveEstimator::try_build(model).unwrap();
    let mut state = estimator.start();
    let mut errors = std::vec::Vec::new();
    for k in 0..6000 {
        let t = k as f32 / RATE_HZ;
        let load = 7.0 * libm::sinf(2.0 * t);
        let estimate = estimator.step(&mut state, &sample(k, motion(t)[0], load));
        if t > 1.0 {
            errors.push(estimate.loads[0].value - drive(t, load));
            assert!(estimate.loads[0].fault.is_none() && estimate.loads[0].std < 3.0);
        }
    }
    assert!(rms(&errors) < 0.8, "{}", rms(&errors));
}

/// At standstill after a motion, a counter that flickers by a count leaves the state of friction:
/// the load that balances it stays.
#[test]
fn a_flickering_count_is_no_reversal() {
    let mut model = model();
    model.directions[0] = Direction::Sliding { distance: 1e-5 };
    let estimator = DriveEstimator::try_build(model).unwrap();
    let mut state = estimator.start();
    let mut errors = std::vec::Vec::new();
    for k in 0..3000_u32 {
        // 0.05 m in the first second, then standstill against friction that holds 4 N.
        let x = 0.05 * (k.min(1000) as f32) / 1000.0 + 0.2 * COUNT;
        let flicker = if k > 1000 && k % 3 == 0 {
            0.7 * COUNT
        } else {
            0.0
        };
        let force = 0.5 + 4.0 + if k < 1000 { 3.0 * 0.05 } else { 0.0 };
        let estimate = estimator.step(&mut state, &sample(k, x + flicker, force));
        if k > 1500 {
            errors.push(estimate.loads[0].value);
        }
    }
    assert!(rms(&errors) < 0.3, "{}", rms(&errors));
}

/// A drive that is recorded 12.4 samples late: as good as on time where the model delays the
/// motion.
#[test]
fn a_late_drive_is_met_by_a_delay_of_the_motion() {
    let run = |delay: f32| {
        let mut model = model();
        model.terms.clear();
        if let Some(position) = &mut model.position {
            position.delay = delay;
        }
        let estimator = DriveEstimator::try_build(model).unwrap();
        let mut state = estimator.start();
        let mut errors = std::vec::Vec::new();
        for k in 0..6000_u32 {
            let t = k as f32 / RATE_HZ;
            let late = t - 0.0124;
            let force = drive(late, 0.0) - 4.0 * libm::copysignf(1.0, motion(late)[1]);
            let estimate = estimator.step(&mut state, &sample(k, motion(t)[0], force));
            if t > 1.0 {
                errors.push(estimate.loads[0].value);
            }
        }
        rms(&errors)
    };
    let (ignored, met) = (run(0.0), run(12.4));
    assert!(met < 0.1 && ignored > 3.0 * met, "{ignored} {met}");
}

/// What depends on the position is left out before the index pulse, and is in the estimate after
/// it.
#[test]
fn a_term_over_the_travel_waits_for_homing() {
    let mut model = model();
    model.terms.clear();
    let slope = Factor::Travel {
        centre: 0.0,
        per_half: 1.0,
        power: 1,
    };
    let term = Term {
        coefficient: 30.0,
        factor: slope,
        direction: None,
    };
    model.terms.push(term).unwrap();
    if let Some(position) = &mut model.position {
        position.at_pulse = Some(10_000);
    }
    let estimator = DriveEstimator::try_build(model).unwrap();
    let mut state = estimator.start();
    for k in 0..4000_u32 {
        let t = k as f32 / RATE_HZ;
        let [x, v, _] = motion(t);
        let force = drive(t, 30.0 * x) - 4.0 * libm::copysignf(1.0, v);
        // The counter starts anywhere: 0.2 m off.
        let mut raw = sample(k, x + 0.2, force);
        if k == 2000 {
            let at_pulse = libm::rintf((0.1 + 0.2) / COUNT) as u32;
            raw.index = Some(at_pulse);
        }
        let load = estimator.step(&mut state, &raw).loads[0];
        if k < 100 {
            assert!(!load.fault.is_none());
        } else if k < 2000 {
            assert_eq!(load.fault, Fault::NotHomed);
        } else if k > 2500 {
            assert!(load.fault.is_none() && load.value.abs() < 1.0, "{load:?}");
        }
    }
}

/// A position that comes late, far from count 0: the load is not valid before it and right after
/// it.
#[test]
fn it_begins_with_the_first_position() {
    let estimator = DriveEstimator::try_build(model()).unwrap();
    let mut state = estimator.start();
    for k in 0..500_u32 {
        let mut raw = sample(k, 0.3, 0.5);
        if k < 3 {
            raw.valid &= !(1 << MAX_CHANNELS);
        }
        let load = estimator.step(&mut state, &raw).loads[0];
        if k < 3 {
            assert_eq!(load.fault, Fault::NotValid);
        } else {
            assert!(load.value.abs() < 20.0, "{k} {load:?}");
        }
    }
}

/// Started in motion against drag, by a position and by a speed: the load is right from the first
/// sample on in which it is valid.
#[test]
fn it_begins_in_motion() {
    for by_speed in [false, true] {
        let mut model = model();
        model.terms.clear();
        if by_speed {
            model.position = None;
            model.speed = Some(Signal {
                noise_std: 0.01,
                ..signal(1.0)
            });
        }
        let estimator = DriveEstimator::try_build(model).unwrap();
        let mut state = estimator.start();
        let mut valid = 0;
        for k in 0..1000_u32 {
            // 0.3 m/s.
            let force = 0.5 + 3.0 * 0.3;
            let mut raw = sample(k, 0.1 + 0.3 * k as f32 / RATE_HZ, force);
            raw.set_word(1, libm::rintf(0.3 / LSB) as i32);
            let load = estimator.step(&mut state, &raw).loads[0];
            if load.fault.is_none() {
                valid += 1;
                assert!(load.value.abs() < 0.05 + 2.0 * load.std, "{k} {load:?}");
            }
        }
        assert!(valid > 900, "{valid}");
    }
}

/// Without readings the deviation grows; after a long gap the estimator starts anew.
#[test]
fn gaps_widen_the_deviation_and_leave_no_trace() {
    let estimator = DriveEstimator::try_build(model()).unwrap();
    let mut state = estimator.start();
    let mut step = |k: u32, whole: bool| {
        let t = k as f32 / RATE_HZ;
        let mut raw = sample(k, motion(t)[0], drive(t, 0.0));
        if !whole {
            raw.valid = 0;
        }
        estimator.step(&mut state, &raw).loads[0]
    };
    let mut std = 0.0;
    for k in 0..2000 {
        std = step(k, true).std;
    }
    for k in 2000..2050 {
        let load = step(k, false);
        assert!(load.std > std && u32::from(load.age) == k - 1999);
        std = load.std;
    }
    for k in (2050..3000).chain(9000..10_000) {
        let load = step(k, true);
        assert!(load.value.is_finite() && load.std.is_finite());
    }
    assert!(step(10_000, true).value.abs() < 1.5);
}

#[test]
fn numbers_out_of_range_are_refused() {
    let refused = |change: fn(&mut DriveModel<'static>)| {
        let mut model = model();
        change(&mut model);
        DriveEstimator::try_build(model).unwrap_err()
    };
    assert_eq!(
        refused(|m| m.position = None),
        Error::OutOfRange("position or speed")
    );
    assert_eq!(
        refused(|m| m.jerk_density = 0.0),
        Error::NotPositive("jerk_density")
    );
    assert_eq!(
        refused(|m| m.inertia = f32::NAN),
        Error::NotFinite("linear part")
    );
    assert_eq!(
        refused(|m| m.directions.clear()),
        Error::OutOfRange("direction")
    );
    assert_eq!(
        refused(|m| m.terms[0].factor = Factor::Load(0)),
        Error::OutOfRange("factor")
    );
    let late = |m: &mut DriveModel<'static>| {
        if let Some(drive) = &mut m.drive {
            drive.delay = MAX_DELAY;
        }
    };
    assert_eq!(refused(late), Error::OutOfRange("delay"));
}

/// The head of an image and the number of its kind, as `docs/wire-format.md` states them.
#[test]
fn an_image_begins_as_the_wire_format_says() {
    use crate::image::{Image, Model, VERSION};
    const SPECIFICATION: &str = include_str!("../../../docs/wire-format.md");
    let image = Image {
        version: VERSION,
        machine: "axis",
        rate_hz: RATE_HZ,
        can_base: 0x500,
        gains: [None; MAX_CHANNELS],
        counted: Vec::new(),
        model: Model::Drive(model()),
    };
    let mut room = [0; 2000];
    let bytes = postcard::to_slice(&image, &mut room).unwrap();
    let line: std::vec::Vec<_> = bytes[..22]
        .iter()
        .map(|b| std::format!("{b:02X}"))
        .collect();
    let line = line.join(" ");
    assert!(SPECIFICATION.contains(&line), "{line}");
    assert_eq!(Image::from_bytes(bytes), Ok(image));
    bytes[21] = 4;
    assert_eq!(Image::from_bytes(bytes), Err(Error::Malformed("image")));
}
