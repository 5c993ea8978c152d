//! Counts the instructions of a step by the timer of the emulated board (`report`), and prints them.
#![allow(unsafe_code, reason = "the timer of the board")]

use core::hint::black_box;
use core::ptr::{read_volatile, write_volatile};

use cortex_m_semihosting::hprintln;

/// Steps over which instructions are averaged.
pub const STEPS: u32 = 1000;

/// CMSDK timer 0 of the board: control, value, reload.
const TIMER: *mut u32 = 0x4000_0000 as *mut u32;

pub fn start_timer() {
    // SAFETY: the addresses are the timer's registers on this board, and
    // nothing else uses them.
    unsafe {
        write_volatile(TIMER.add(2), u32::MAX);
        write_volatile(TIMER.add(1), u32::MAX);
        write_volatile(TIMER, 1);
    }
}

pub fn timer() -> u32 {
    // SAFETY: as above.
    unsafe { read_volatile(TIMER.add(1)) }
}

/// Instructions that `STEPS` calls take, loop included.
#[inline(never)]
pub fn count(mut step: impl FnMut(u32)) -> u64 {
    let before = timer();
    for k in 0..STEPS {
        step(black_box(k));
    }
    u64::from(before - timer()) * 10 / 256
}

pub fn report(name: &str, step: impl FnMut(u32)) {
    let harness = count(|k| {
        black_box(k);
    });
    let total = count(step);
    let per_step = (total - harness + u64::from(STEPS) / 2) / u64::from(STEPS);
    hprintln!("{} {}", name, per_step);
}
