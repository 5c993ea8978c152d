//! Measures the instructions that load counting takes for a sample (mean for a slow load and for
//! white noise, worst case); also prints a digest of the counts and their bytes of memory.

use core::hint::black_box;

use alloc::vec::Vec;
use cortex_m_semihosting::hprintln;
use loadtwin_common::counting::saved_counts::MAX_BYTES;
use loadtwin_common::counting::{LevelScale, LoadCounts};
use loadtwin_firmware::counting_test::{Load, digest, empty};

use crate::timing::{STEPS, report, timer};

/// A part of a turn [2^-32 turn].
const ADVANCE: [u32; 2] = [0x0123_4567, 0x0031_2345];

/// Levels from which one full swing closes 64 cycles: ranges that grow to the whole scale and
/// shrink again; and full swings.
fn worst() -> Vec<f32> {
    let mut levels = Vec::new();
    let mut level = 63.0_f32;
    levels.push(level);
    for (k, range) in (1..128).chain((1..128).rev()).enumerate() {
        level += if k % 2 == 0 { 1.0 } else { -1.0 } * range as f32;
        levels.push(level);
    }
    levels.extend((0..40).map(|k| if k % 2 == 0 { 127.0 } else { 0.0 }));
    levels
}

/// Mean for a load that moves slowly with noise, mean for white noise, and the most that one
/// sample takes; the digest of counts.
// Inlined, its counts would be on the stack below that of the estimator.
#[inline(never)]
pub fn counting() {
    let mut load = Load::new(1);
    let torques: Vec<f32> = (0..STEPS).map(|_| load.next_nm()).collect();
    let mut counts = black_box(empty(2).unwrap());
    report("counting", |k| {
        counts.push(Some(black_box(torques[k as usize])), ADVANCE);
    });
    let mut random = loadtwin_firmware::counting_test::Random::new(1);
    let torques: Vec<f32> = (0..STEPS).map(|_| 1000.0 * random.number()).collect();
    let mut counts = black_box(empty(1).unwrap());
    report("counting_white", |k| {
        counts.push(Some(black_box(torques[k as usize])), ADVANCE);
    });
    let scale = LevelScale::try_new(-0.5, 1.0).unwrap();
    let mut counts = black_box(LoadCounts::try_new(scale, 1).unwrap());
    let most = (worst().into_iter())
        .map(|level| {
            let before = timer();
            counts.push(Some(black_box(level)), ADVANCE);
            before - timer()
        })
        .max();
    hprintln!("counting_most {}", most.unwrap_or(0) * 10 / 256);
    let mut bytes = alloc::vec![0; MAX_BYTES];
    hprintln!(
        "counting_digest {}",
        digest(45, 100_000, &mut bytes).unwrap()
    );
    hprintln!("counting_bytes {}", size_of::<LoadCounts>());
}
