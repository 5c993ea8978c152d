//! Fatal errors of the emulated board: stack overflow and a stopped sample clock end in a fault
//! or a watchdog reset.

use std::thread;
use std::time::Duration;

use loadtwin_common::io::frame::Frame;
use loadtwin_firmware::stimulus::Stimulus;
use loadtwin_tests::emulator::{self, Emulator, flash};
use loadtwin_tests::gearbox::samples;

#[test]
fn a_stack_that_overflows_faults() {
    let end = emulator::run("overflow");
    assert!(!end.status.success(), "{}", end.log);
    let address = end
        .log
        .split_once("forbidden 0x")
        .map(|(_, rest)| rest)
        .and_then(|rest| u32::from_str_radix(rest.lines().next()?.trim(), 16).ok())
        .unwrap_or_else(|| panic!("{}", end.log));
    // Just below the memory, of which the stack is the lowest part.
    assert!(
        (0x1FFF_8000..0x2000_0000).contains(&address),
        "{address:#x}"
    );
}

/// The main loop turns on with every byte from the bus, and feeds the watchdog
/// all the same only while samples are processed.
#[test]
fn a_sample_clock_that_stands_still_meets_the_watchdog() {
    let key = loadtwin::key::SigningKey::generate().unwrap();
    let board = Emulator::start_paced(&flash(&key, &[]));
    let mut bus = board.bus();
    let mut sensors = board.sensors();
    for sample in samples(20) {
        sensors.send(&Stimulus::Sample(sample));
    }
    sensors.send(&Stimulus::Stop);
    let frame = Frame {
        id: 0x7FF,
        data: [0; 8],
    };
    // A minute of it at most; the board is gone long before.
    let gone = (0..6000).any(|_| {
        thread::sleep(Duration::from_millis(10));
        !bus.try_send(&frame)
    });
    assert!(gone, "the board runs on");
    let end = board.end(Duration::from_secs(20));
    assert!(
        !end.status.success() && end.log.contains("watchdog"),
        "{}\n{}",
        end.status,
        end.log
    );
}
