//! The application on the emulated board says what it says on the host.

use std::time::Duration;

use loadtwin_common::frame::Frame;
use loadtwin_tests::emulator::Emulator;
use loadtwin_tests::gearbox::{image, is_estimate, on_host, samples};

#[test]
fn a_minute_of_samples_gives_the_same_payloads_on_the_board_and_on_the_host() {
    let (image, samples) = (image(), samples(60_000));
    let board = Emulator::start(&image);
    let bus = board.bus();
    let sent = board.sensors().send_all(samples.clone());
    let frames: Vec<Frame> = bus.filter(is_estimate).collect();
    let end = board.end(Duration::from_secs(10));
    assert!(end.status.success(), "{}\n{}", end.status, end.log);
    sent.join().unwrap();

    let mut expected = on_host(&image, &samples, false);
    expected.retain(is_estimate);
    let differ = frames
        .iter()
        .zip(&expected)
        .position(|(board, host)| board != host);
    assert_eq!(differ, None, "first frame that differs");
    assert_eq!(frames.len(), expected.len());
}
