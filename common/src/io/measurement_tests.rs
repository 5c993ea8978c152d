//! Unit tests of the conversion of raw samples: saturation, stuck words, unwrapping of counts,
//! eccentric disc, homing by the index pulse, missing and false pulses, lost and late samples.

use crate::io::measurement::*;

const CONVERTER: AdcScaling = AdcScaling {
    zero: 100,
    gain: 0.5,
    lowest: -8_388_608,
    highest: 8_388_607,
    stuck_after: 3,
};
// 4 counts a turn on a 16-bit counter.
const COUNTER: EncoderScaling = EncoderScaling {
    step: PhaseStep(1 << 62),
    bits: 16,
};
const INDEX: IndexPulse = IndexPulse {
    encoder: 0,
    angle: Phase(1 << 63),
    tolerance_rad: 0.1,
    eccentricity: None,
};

fn sample(tick: u32, word: i32, count: u32) -> RawSample {
    let mut raw = RawSample {
        tick,
        ..RawSample::default()
    };
    raw.set_word(0, word);
    raw.set_encoder(0, count);
    raw
}

fn convert(unwrap: &mut SignalConditioner, raw: &RawSample) -> Measurement {
    unwrap.convert(
        raw,
        &[CONVERTER],
        &[COUNTER],
        Some(&INDEX),
        Phase::default(),
    )
}

#[test]
fn a_word_becomes_a_reading() {
    let m = convert(&mut SignalConditioner::default(), &sample(0, 104, 0));
    assert_eq!(m.values[0], Ok(2.0));
    assert_eq!(m.values[1], Err(Fault::Missing));
}

#[test]
fn the_ends_of_the_converter_are_saturation() {
    let mut unwrap = SignalConditioner::default();
    assert_eq!(
        convert(&mut unwrap, &sample(0, 8_388_607, 0)).values[0],
        Err(Fault::SaturatedHigh)
    );
    assert_eq!(
        convert(&mut unwrap, &sample(1, -8_388_608, 0)).values[0],
        Err(Fault::SaturatedLow)
    );
}

#[test]
fn a_word_that_repeats_is_stuck_until_it_moves() {
    let mut unwrap = SignalConditioner::default();
    for tick in 0..3 {
        assert_eq!(
            convert(&mut unwrap, &sample(tick, 7, 0)).values[0],
            Ok(-46.5)
        );
    }
    assert_eq!(
        convert(&mut unwrap, &sample(3, 7, 0)).values[0],
        Err(Fault::Stuck)
    );
    assert_eq!(convert(&mut unwrap, &sample(4, 8, 0)).values[0], Ok(-46.0));
}

#[test]
fn counts_unwrap_both_ways_over_the_end_of_the_counter() {
    let mut unwrap = SignalConditioner::default();
    convert(&mut unwrap, &sample(0, 1, 65_535));
    assert_eq!(
        convert(&mut unwrap, &sample(1, 2, 0)).angles[0],
        Ok(Phase(1 << 62))
    );
    assert_eq!(
        convert(&mut unwrap, &sample(2, 3, 65_534)).angles[0],
        Ok(Phase((-1_i64 << 62) as u64))
    );
}

/// Homes on count 11 and stands one quarter turn later.
fn homed() -> SignalConditioner {
    let mut unwrap = SignalConditioner::default();
    assert!(!convert(&mut unwrap, &sample(0, 1, 10)).homed);
    let m = convert(
        &mut unwrap,
        &RawSample {
            index: Some(11),
            ..sample(1, 2, 12)
        },
    );
    assert_eq!(m.angles[0], Ok(Phase(3 << 62)));
    assert!(m.homed && m.rehomed.is_some());
    unwrap
}

/// A disc that reads `0.01 (cos a - 1) + 0.02 sin a` ahead at `a` past the pulse.
#[test]
fn an_eccentric_disc_is_set_right_once_homed() {
    const STEPS: u32 = 1000;
    let error = |past: f32| 0.01 * (libm::cosf(past) - 1.0) + 0.02 * libm::sinf(past);
    let counter = EncoderScaling {
        step: PhaseStep(u64::MAX / 1_000_000),
        bits: 32,
    };
    let index = IndexPulse {
        eccentricity: Some(Eccentricity {
            cosine_rad: 0.01,
            sine_rad: 0.02,
        }),
        ..INDEX
    };
    let mut unwrap = SignalConditioner::default();
    for tick in 0..3 * STEPS {
        // The pulse comes at half a turn, from where the count begins.
        let turns = tick as f32 / STEPS as f32;
        let past = core::f32::consts::TAU * (turns - 0.5);
        let count =
            |turns: f32, error: f32| ((turns + error / core::f32::consts::TAU) * 1e6 + 1e4) as u32;
        let raw = RawSample {
            index: (tick % STEPS == STEPS / 2).then(|| count(turns, 0.0)),
            ..sample(tick, tick as i32, count(turns, error(past)))
        };
        let none = Phase::default();
        let m = unwrap.convert(&raw, &[CONVERTER], &[counter], Some(&index), none);
        assert!(!m.slipped, "{tick}");
        let true_angle = Phase::from_rad(past).wrapping_add(INDEX.angle);
        let off = m.angles[0].unwrap().wrapping_sub(true_angle).to_rad();
        // At first order, and to a count.
        assert!(!m.homed || off.abs() < 1e-3, "{tick}: {off}");
        assert!(m.homed || tick < STEPS / 2);
    }
}

#[test]
fn a_pulse_where_it_is_expected_changes_nothing() {
    let m = convert(
        &mut homed(),
        &RawSample {
            index: Some(15),
            ..sample(2, 3, 16)
        },
    );
    assert_eq!((m.rehomed, m.slipped), (None, false));
}

#[test]
fn a_false_pulse_is_reported_and_forgotten() {
    let mut unwrap = homed();
    let m = convert(
        &mut unwrap,
        &RawSample {
            index: Some(13),
            ..sample(2, 3, 13)
        },
    );
    assert_eq!((m.rehomed, m.slipped), (None, true));
    let m = convert(
        &mut unwrap,
        &RawSample {
            index: Some(15),
            ..sample(3, 4, 16)
        },
    );
    assert_eq!((m.rehomed, m.slipped), (None, false));
}

#[test]
fn a_lost_count_is_mended_by_the_second_late_pulse() {
    let mut unwrap = homed();
    let m = convert(
        &mut unwrap,
        &RawSample {
            index: Some(14),
            ..sample(2, 3, 15)
        },
    );
    assert_eq!((m.rehomed, m.slipped), (None, true));
    let m = convert(
        &mut unwrap,
        &RawSample {
            index: Some(18),
            ..sample(3, 4, 19)
        },
    );
    assert_eq!((m.rehomed, m.slipped), (Some(Phase(1 << 62)), false));
    assert_eq!(m.angles[0], Ok(Phase(3 << 62)));
}

/// An encoder that turns by a hundredth at a time, with the pulse at half a turn.
#[test]
fn a_pulse_that_does_not_come_is_told_until_the_next_one() {
    let counter = EncoderScaling {
        step: PhaseStep((1 << 63) / 50),
        bits: 16,
    };
    let mut unwrap = SignalConditioner::default();
    for tick in 0..400_u32 {
        let mut raw = sample(tick, tick as i32, tick);
        // The third is missing; a swing back and forth passes no place.
        raw.index = (tick % 100 == 50 && tick != 250).then_some(tick);
        let m = unwrap.convert(
            &raw,
            &[CONVERTER],
            &[counter],
            Some(&INDEX),
            Phase::default(),
        );
        // 0.1 rad are 1.6 counts.
        assert_eq!(m.slipped, (252..350).contains(&tick), "{tick}");
    }
}

#[test]
fn a_sample_that_comes_twice_or_late_is_not_used() {
    let mut unwrap = SignalConditioner::default();
    convert(&mut unwrap, &sample(5, 1, 10));
    assert_eq!(convert(&mut unwrap, &sample(7, 2, 12)).lost, 1);
    for tick in [7, 6] {
        let m = convert(&mut unwrap, &sample(tick, 3, 13));
        assert!(m.stale && m.lost == 0);
        assert_eq!(
            (m.values[0], m.angles[0]),
            (Err(Fault::Missing), Err(Fault::Missing))
        );
    }
    let m = convert(&mut unwrap, &sample(8, 4, 14));
    assert!(!m.stale && m.lost == 0 && m.values[0].is_ok());
    // Far back is a new start.
    assert!(convert(&mut unwrap, &sample(u32::MAX - 1000, 4, 14)).lost > 1 << 30);
}

#[test]
fn lost_samples_are_counted() {
    let mut unwrap = SignalConditioner::default();
    assert_eq!(convert(&mut unwrap, &sample(u32::MAX, 1, 0)).lost, 0);
    assert_eq!(convert(&mut unwrap, &sample(3, 2, 0)).lost, 3);
}

#[test]
fn a_pulse_while_the_count_stands_still_shows_a_frozen_encoder() {
    let pulse = |tick, count, latched| RawSample {
        index: Some(latched),
        ..sample(tick, tick as i32, count)
    };
    // From the start: it homes nothing.
    let mut unwrap = SignalConditioner::default();
    convert(&mut unwrap, &sample(0, 0, 10));
    let m = convert(&mut unwrap, &pulse(1, 10, 7));
    assert_eq!((m.homed, m.angles[0]), (false, Err(Fault::Stuck)));
    // Later: since the last pulse, until the count changes.
    let mut unwrap = homed();
    for tick in 2..4 {
        let m = convert(&mut unwrap, &sample(tick, tick as i32, 12));
        assert!(m.angles[0].is_ok() && !m.slipped);
    }
    for tick in 4..6 {
        let m = convert(&mut unwrap, &pulse(tick, 12, 12));
        assert_eq!((m.slipped, m.angles[0]), (true, Err(Fault::Stuck)));
    }
    let m = convert(&mut unwrap, &sample(6, 6, 15));
    assert!(m.angles[0].is_ok() && !m.slipped);
}

/// A shift of the counts is taken back, and the next pulse stands where it is expected.
#[test]
fn a_pulse_after_a_shift_that_was_taken_back_is_where_it_is_expected() {
    let mut unwrap = homed();
    let before = convert(&mut unwrap, &sample(2, 2, 13)).angles[0];
    let jumped = convert(&mut unwrap, &sample(3, 3, 1013)).angles[0];
    let by = jumped.unwrap().wrapping_sub(before.unwrap());
    unwrap.shift(0, Phase::default().wrapping_sub(by));
    assert_eq!(convert(&mut unwrap, &sample(4, 4, 1013)).angles[0], before);
    let m = convert(
        &mut unwrap,
        &RawSample {
            index: Some(1015),
            ..sample(5, 5, 1016)
        },
    );
    assert_eq!((m.rehomed, m.slipped), (None, false));
}
