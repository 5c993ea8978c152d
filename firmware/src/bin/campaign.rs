//! Runs the fault-injection campaign on the emulated Cortex-M4F: reads model image, machine and
//! recording from memory, and prints the report as hex digits of postcard through semihosting.
//!
//! `MODEL` holds, each after its length in 32 bits: the model image, the postcard of
//! the machine, and the postcards of the samples, one after the other.
#![no_std]
#![no_main]
#![allow(unsafe_code)]

use core::panic::PanicInfo;
use core::slice;

use cortex_m_rt::entry;
use cortex_m_semihosting::{debug, hprint, hprintln};
use heapless::Vec;
use loadtwin_common::estimator::Estimator;
use loadtwin_common::image::Image;
use loadtwin_common::io::raw::RawSample;
use loadtwin_firmware::campaign::{self, Machine};
use static_cell::StaticCell;

/// Samples that the recording has at most.
const SAMPLES: usize = 12_000;
/// Samples until the estimator has settled, the index included.
const SETTLE: usize = 1000;

/// The next part of `MODEL` and what is behind it.
fn part(from: &'static [u8]) -> (&'static [u8], &'static [u8]) {
    let (length, rest) = from.split_at(4);
    let length = u32::from_le_bytes([length[0], length[1], length[2], length[3]]);
    rest.split_at(length as usize)
}

#[entry]
fn main() -> ! {
    static RECORDING: StaticCell<Vec<RawSample, SAMPLES>> = StaticCell::new();

    // SAFETY: `MODEL` in memory/emulated.x, a megabyte that nothing writes.
    let model = unsafe { slice::from_raw_parts(0x0030_0000 as *const u8, 0x0010_0000) };
    let (image, rest) = part(model);
    let (machine, rest) = part(rest);
    let (mut samples, _) = part(rest);
    let image = Image::from_bytes(image).expect("the image is valid");
    let line = Estimator::try_build(image).expect("the model is valid");
    let machine: Machine = postcard::from_bytes(machine).expect("a machine");
    let recording = RECORDING.init_with(Vec::new);
    while !samples.is_empty() {
        let (sample, rest) = postcard::take_from_bytes(samples).expect("a sample");
        recording.push(sample).expect("room for the samples");
        samples = rest;
    }
    let report = campaign::run(&line, &machine, recording, SETTLE);
    let mut room = [0; 2048];
    let bytes = postcard::to_slice(&report, &mut room).expect("it fits");
    hprint!("report ");
    for bytes in bytes.chunks(32) {
        for byte in bytes {
            hprint!("{:02x}", byte);
        }
    }
    hprintln!("");
    debug::exit(debug::EXIT_SUCCESS);
    loop {
        cortex_m::asm::wfi();
    }
}

#[panic_handler]
fn panic(info: &PanicInfo) -> ! {
    hprintln!("{}", info);
    debug::exit(debug::EXIT_FAILURE);
    loop {
        cortex_m::asm::wfi();
    }
}
