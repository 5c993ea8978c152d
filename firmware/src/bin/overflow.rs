//! Test program that overflows the stack of the emulated board: it has to end in a fault before
//! other memory is overwritten.
#![no_std]
#![no_main]

#[path = "emulated/exit.rs"]
mod exit;
#[path = "boards/stack_guard.rs"]
mod stack_guard;

use core::hint::black_box;

use cortex_m_rt::entry;
use defmt_semihosting as _;

fn deeper(depth: u32) -> u32 {
    let room = black_box([depth; 32]);
    let below = if black_box(true) {
        deeper(depth + 1)
    } else {
        0
    };
    below.wrapping_add(room[31])
}

#[entry]
fn main() -> ! {
    stack_guard::forbid_below_stack();
    defmt::error!("came back from depth {=u32}", deeper(0));
    exit::success()
}
