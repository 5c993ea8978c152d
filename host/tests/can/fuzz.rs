//! Fuzz test of frames and logs: any bytes give no panic, and nothing is accepted in part.

use std::time::Duration;

use loadtwin::can::Model;
use loadtwin::can::bus::{Bus, BusError, Received};
use loadtwin::can::frame_comparison::Comparison;
use loadtwin::can::log::LogBus;
use loadtwin_common::io::frame;
use loadtwin_common::io::frame::{DEFAULT_BASE, FrameEncoder, RawAssembler};
use loadtwin_common::io::raw::RawSample;
use proptest::prelude::*;
use proptest::test_runner::{RngSeed, TestRunner};

use crate::machine::{image, samples, traffic};

/// Cases of the two tests on frames together: 10^6.
const CASES: u32 = 500_000;

fn config(cases: u32) -> ProptestConfig {
    ProptestConfig {
        cases,
        failure_persistence: None,
        rng_seed: RngSeed::Fixed(1),
        ..ProptestConfig::default()
    }
}

#[test]
fn a_frame_of_any_bytes_is_taken_whole_or_not_at_all() {
    let mut runner = TestRunner::new(config(CASES));
    let bytes = prop_oneof![
        8 => any::<[u8; 8]>().prop_map(|b| b.to_vec()),
        1 => prop::collection::vec(any::<u8>(), 0..65),
    ];
    let strategy = (0_u16..0x800, bytes, any::<bool>());
    runner
        .run(&strategy, |(id, mut data, fit)| {
            // Half of them with a check that fits, so that the fields are reached.
            if fit && let Ok(mut eight) = <[u8; 8]>::try_from(data.as_slice()) {
                frame::e2e::protect(frame::e2e::data_id(id), eight[2], &mut eight);
                data = eight.to_vec();
            }
            if let Ok((message, _)) = frame::decode(DEFAULT_BASE, id, &data) {
                prop_assert!(
                    ((DEFAULT_BASE..DEFAULT_BASE + 15).contains(&id) || id == DEFAULT_BASE + 16)
                        && data.len() == 8
                );
                if let frame::Message::Load(_, load) = message {
                    prop_assert!(load.value(1.0).is_none_or(|v| v.abs() <= 1.0));
                    prop_assert!(load.std(1.0).is_none_or(|s| (0.0..0.5).contains(&s)));
                }
            }
            let mut assembler = RawAssembler::new(DEFAULT_BASE);
            assembler.push(id, &data);
            Ok(())
        })
        .expect("no case fails");
}

#[test]
fn raw_samples_survive_and_damage_to_them_does_not() {
    let mut runner = TestRunner::new(config(CASES));
    let encoder = FrameEncoder::try_new(DEFAULT_BASE, 1000.0, [1.0], 0).expect("good");
    let strategy = (
        any::<(u32, [i32; 8], [u32; 2], Option<u32>)>(),
        0_u16..1024,
        any::<prop::sample::Index>(),
        0_usize..64,
        1_u8..=255,
    );
    runner
        .run(
            &strategy,
            |((tick, words, encoders, index), valid, which, byte, change)| {
                let mut sample = RawSample {
                    tick,
                    index,
                    ..RawSample::default()
                };
                for (i, word) in words
                    .into_iter()
                    .enumerate()
                    .filter(|(i, _)| valid & 1 << i != 0)
                {
                    sample.set_word(i, word);
                }
                for (k, count) in encoders
                    .into_iter()
                    .enumerate()
                    .filter(|(k, _)| valid & 256 << k != 0)
                {
                    sample.set_encoder(k, count);
                }
                let mut frames = Vec::new();
                encoder.raw(&sample, |frame| {
                    frames.push((frame.id, frame.data.to_vec()));
                });
                let fd = encoder.raw_fd(&sample);
                let push = |frames: &[(u16, Vec<u8>)]| {
                    let mut assembler = RawAssembler::new(DEFAULT_BASE);
                    frames
                        .iter()
                        .filter_map(|(id, data)| assembler.push(*id, data))
                        .last()
                };
                prop_assert_eq!(push(&frames), Some(sample));
                prop_assert_eq!(push(&[(fd.id, fd.data.to_vec())]), Some(sample));
                // A burst of up to 8 bits.
                let at = which.index(frames.len());
                frames[at].1[byte % 8] ^= change;
                prop_assert_eq!(push(&frames), None);
                let mut data = fd.data;
                data[byte] ^= change;
                prop_assert_eq!(push(&[(fd.id, data.to_vec())]), None);
                Ok(())
            },
        )
        .expect("no case fails");
}

#[test]
fn a_log_of_any_bytes_ends_and_a_spoilt_log_never_makes_a_difference_of_nothing() {
    let image = image();
    let model = Model::from_bytes(&image).expect("good");
    let lines: Vec<String> = traffic(&model, &samples(40, |_| false), false)
        .into_iter()
        .map(|Received { t_us, frame }| {
            format!(
                "({}.{:06}) vcan0 {frame}",
                t_us / 1_000_000,
                t_us % 1_000_000
            )
        })
        .collect();
    let log = lines.join("\n").into_bytes();
    let mut runner = TestRunner::new(config(3000));
    let edits = prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..20);
    let strategy = (prop::collection::vec(any::<u8>(), 0..300), edits);
    runner
        .run(&strategy, |(noise, edits)| {
            let mut spoilt = log.clone();
            for (at, byte) in edits {
                let at = at.index(spoilt.len());
                spoilt[at] = byte;
            }
            spoilt.extend(noise);
            let mut bus = LogBus::new(spoilt.as_slice(), None).expect("memory");
            let mut comparison = Comparison::new(model.clone()).expect("good");
            loop {
                match bus.receive(Duration::ZERO) {
                    Ok(Some(received)) => comparison.take(&received),
                    Ok(None) => prop_assert!(false, "a log does not time out"),
                    Err(BusError::Ended) => break,
                    Err(error) => prop_assert!(false, "{error}"),
                }
            }
            prop_assert_eq!(comparison.figures().differing_frames, 0);
            Ok(())
        })
        .expect("no case fails");
}
