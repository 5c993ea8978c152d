//! Link-time check that no panic is reachable from a data-ready: the panic handler calls an
//! undefined symbol, so that the program links only where the optimiser removes the handler.
//!
//! The queues to the bus are left out. heapless's `spsc` takes a remainder by its
//! length, which its type-erased ends no longer know; it is a constant of the
//! boards, and that division the only panic that stays.
//!
//! With `--cfg control` a panic is reachable and the link has to fail; without
//! that the check could pass because it checks nothing.
#![no_std]
#![no_main]
#![allow(unsafe_code)]

use core::panic::PanicInfo;

use heapless::Vec;
use loadtwin_common::counting::CountSample;
use loadtwin_common::io::frame::Frame;
use loadtwin_common::io::raw::RawSample;
use loadtwin_firmware::app::{App, MAX_FRAMES};
use loadtwin_firmware::board::Board;
use loadtwin_firmware::board_counters::Counters;
use loadtwin_firmware::raw_burst::RawWriter;

struct Bare<'a> {
    sample: Option<RawSample>,
    outbox: Vec<Frame, MAX_FRAMES>,
    counted: Option<CountSample>,
    counters: &'a Counters,
}

impl Board for Bare<'_> {
    fn acquire(&mut self) -> Option<RawSample> {
        self.sample.take()
    }

    fn queue(&mut self, frame: Frame) -> Result<(), Frame> {
        self.outbox.push(frame)
    }

    fn count(&mut self, sample: CountSample) {
        self.counted = Some(sample);
    }

    fn overrun(&mut self) -> bool {
        false
    }

    fn raw_writer(&mut self) -> Option<&mut RawWriter<'static>> {
        None
    }

    fn counters(&self) -> &Counters {
        self.counters
    }
}

// SAFETY: the name is the only one of its kind in this program, which never runs.
#[unsafe(no_mangle)]
fn on_data_ready(app: &mut App, board: &mut Bare) {
    #[cfg(control)]
    assert!(board.sample.is_some());
    app.on_data_ready(board);
    app.announce(board);
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    unsafe extern "C" {
        fn a_panic_is_reachable() -> !;
    }
    // SAFETY: never linked; that is the point.
    unsafe { a_panic_is_reachable() }
}
