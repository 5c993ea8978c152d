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

#[test]
fn a_damaged_image_is_refused_and_the_board_says_so_on_the_bus() {
    let mut image = image();
    image.truncate(image.len() - 1);
    let board = Emulator::start(&image);
    let bus = board.bus();
    let sent = board.sensors().send_all(samples(100));
    let frames: Vec<Frame> = bus.collect();
    let end = board.end(Duration::from_secs(10));
    assert!(end.status.success(), "{}\n{}", end.status, end.log);
    sent.join().unwrap();

    assert!(end.log.contains("no usable model"), "{}", end.log);
    let no_image = |frame: &Frame| {
        use loadtwin_common::frame::{DEFAULT_BASE, Message, State, decode};
        matches!(
            decode(DEFAULT_BASE, frame.id, &frame.data),
            Ok((Message::Status(status, _), _)) if status.state == State::NoImage
        )
    };
    assert!(frames.len() >= 100 && frames.iter().all(no_image));
}
