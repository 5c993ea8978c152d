//! Bit identity of the emulated board and the host for a gearbox and a rotor.

use std::time::Duration;

use loadtwin_common::io::frame::Frame;
use loadtwin_common::io::raw::RawSample;
use loadtwin_tests::emulator::Emulator;
use loadtwin_tests::gearbox::{self, is_estimate, on_host};
use loadtwin_tests::rotor;

const WITHIN: Duration = Duration::from_secs(10);

/// Runs `samples` on both sides: the board's frames, which are those of the host. The board
/// ends `within` a time.
pub fn compare(name: &str, image: &[u8], samples: &[RawSample], within: Duration) -> Vec<Frame> {
    let board = Emulator::start_stored(image, samples);
    let bus = board.bus();
    board.sensors().send_stored();
    let frames: Vec<Frame> = bus.filter(is_estimate).collect();
    let end = board.end(within);
    assert!(end.status.success(), "{name}: {}\n{}", end.status, end.log);

    let mut expected = on_host(image, samples, false);
    expected.retain(is_estimate);
    let differ = frames
        .iter()
        .zip(&expected)
        .position(|(board, host)| board != host);
    assert_eq!(differ, None, "{name}: first frame that differs");
    assert!(!frames.is_empty(), "{name}");
    assert_eq!(frames.len(), expected.len(), "{name}");
    frames
}

/// Seconds of samples, or `LOADTWIN_SECONDS`; a thousand samples each.
const SECONDS: u32 = 20;

#[test]
fn samples_give_the_same_payloads_on_the_board_and_on_the_host() {
    let seconds = loadtwin_tests::seconds(SECONDS);
    let samples = gearbox::samples(1000 * seconds);
    compare("gearbox", &gearbox::image(), &samples, WITHIN);
}

#[test]
fn a_rotor_through_its_critical_speed_gives_the_same_payloads_too() {
    for (name, machine) in [
        ("rotor", rotor::machine()),
        ("rotor whose estimates lag", rotor::walking()),
    ] {
        let samples = rotor::samples(&machine, 2.0);
        compare(name, &rotor::image(&machine), &samples, WITHIN);
    }
}
