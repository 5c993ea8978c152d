//! Unit tests of raw-sample frames: round trip, lost, repeated and swapped frames, detection of
//! bit errors.

use crate::io::frame::DEFAULT_BASE;
use crate::io::frame::raw_frame::*;

fn sample(tick: u32) -> RawSample {
    let mut sample = RawSample {
        tick,
        ..RawSample::default()
    };
    sample.set_word(0, -8_388_608);
    sample.set_word(1, 1);
    sample.set_word(3, i32::MIN);
    sample.set_encoder(0, u32::MAX);
    sample.set_encoder(1, tick.wrapping_mul(77));
    sample
}

fn frames(sample: &RawSample) -> heapless::Vec<Frame, 7> {
    let mut frames = heapless::Vec::new();
    raw_frames(DEFAULT_BASE, sample, |frame| {
        frames.push(frame).expect("at most seven");
    });
    frames
}

fn push_all<'a>(
    assembler: &mut RawAssembler,
    frames: impl IntoIterator<Item = &'a Frame>,
) -> Option<RawSample> {
    let mut last = None;
    for frame in frames {
        last = assembler.push(frame.id, &frame.data);
    }
    last
}

#[test]
fn a_sample_of_four_gauges_and_two_encoders_takes_four_frames() {
    let frames = frames(&sample(5));
    assert_eq!(
        frames
            .iter()
            .map(|f| f.id - DEFAULT_BASE)
            .collect::<heapless::Vec<_, 7>>(),
        [8, 9, 10, 13]
    );
}

#[test]
fn every_pattern_of_delivery_survives_both_ways() {
    let mut classic = RawAssembler::new(DEFAULT_BASE);
    let mut fd = RawAssembler::new(DEFAULT_BASE);
    let mut tick = u32::MAX - 100;
    for valid in 0..1024 {
        for index in [None, Some(0), Some(0xFEDC_BA98)] {
            tick = tick.wrapping_add(1);
            let mut sample = RawSample {
                tick,
                index,
                ..RawSample::default()
            };
            for i in 0..8 {
                if valid & 1 << i != 0 {
                    sample.set_word(i, (tick as i32).wrapping_mul(0x0101_0173 * (i as i32 + 1)));
                }
            }
            for k in 0..2 {
                if valid & 256 << k != 0 {
                    sample.set_encoder(k, tick.wrapping_mul(0x1234_5677 + k as u32));
                }
            }
            assert_eq!(push_all(&mut classic, &frames(&sample)), Some(sample));
            let frame = raw_fd_frame(DEFAULT_BASE, &sample);
            assert_eq!(fd.push(frame.id, &frame.data), Some(sample));
        }
    }
    let whole = RawCounts {
        samples: 3072,
        ..RawCounts::default()
    };
    assert_eq!((classic.counts(), fd.counts()), (whole, whole));
}

#[test]
fn any_lost_repeated_or_swapped_frame_is_noticed_and_the_next_sample_is_whole() {
    let (first, second) = (frames(&sample(1)), frames(&sample(2)));
    let third = sample(3);
    for i in 0..first.len() {
        for fault in ["lost", "repeated", "swapped"] {
            let mut stream: heapless::Vec<Frame, 16> = first.iter().copied().collect();
            match fault {
                "lost" => drop(stream.remove(i)),
                "repeated" => stream.insert(i, first[i]).expect("room"),
                _ if i + 1 < first.len() => stream.swap(i, i + 1),
                _ => continue,
            }
            let mut assembler = RawAssembler::new(DEFAULT_BASE);
            let mut got = heapless::Vec::<RawSample, 4>::new();
            for frame in stream.iter().chain(&second).chain(&frames(&third)) {
                if let Some(sample) = assembler.push(frame.id, &frame.data) {
                    got.push(sample).expect("room");
                }
            }
            let counts = assembler.counts();
            assert!(
                counts.incomplete + counts.stray + counts.damaged > 0,
                "{fault} {i}"
            );
            for sample_got in &got {
                assert_eq!(*sample_got, sample(sample_got.tick));
            }
            assert!(got.ends_with(&[sample(2), third]), "{fault} {i}");
        }
    }
}

#[test]
fn frames_of_two_samples_do_not_make_one() {
    let (first, second) = (frames(&sample(1)), frames(&sample(2)));
    for cut in 1..first.len() {
        let mut assembler = RawAssembler::new(DEFAULT_BASE);
        let mixed = first.iter().take(cut).chain(second.iter().skip(cut));
        let got = push_all(&mut assembler, mixed);
        // Where the frames after the cut are equal in both, the mixture is the sample.
        let equal = first.iter().skip(cut).eq(second.iter().skip(cut));
        assert_eq!(got, equal.then(|| sample(1)), "cut {cut}");
    }
}

#[test]
fn lost_samples_are_counted_over_the_wrap_of_the_tick() {
    let mut assembler = RawAssembler::new(DEFAULT_BASE);
    for tick in [u32::MAX - 1, 2, 3, 3] {
        push_all(&mut assembler, &frames(&sample(tick)));
    }
    let counts = assembler.counts();
    assert_eq!((counts.samples, counts.lost, counts.backward), (4, 3, 1));
}

#[test]
fn every_error_of_up_to_two_bits_in_a_classic_sample_is_found() {
    let sent = frames(&sample(9));
    let bits = sent.len() * 64;
    let flipped = |frames: &mut heapless::Vec<Frame, 7>, bit: usize| {
        frames[bit / 64].data[bit % 64 / 8] ^= 1 << (bit % 8);
    };
    for a in 0..bits {
        for b in a..bits {
            let mut got = sent.clone();
            flipped(&mut got, a);
            if b != a {
                flipped(&mut got, b);
            }
            let mut assembler = RawAssembler::new(DEFAULT_BASE);
            for frame in &got {
                assert_eq!(assembler.push(frame.id, &frame.data), None, "bits {a} {b}");
            }
        }
    }
}
