//! A burst of raw samples of the emulated board, asked for over its bus while it runs: the host
//! recomputes it bit for bit.

use std::thread;
use std::time::Duration;

use loadtwin::can::bus::Received;
use loadtwin::can::frame_comparison::{Comparison, Verdict};
use loadtwin::can::{Model, to_bus};
use loadtwin_common::io::frame::Frame;
use loadtwin_common::io::isotp::single_frame;
use loadtwin_common::io::uds;
use loadtwin_firmware::stimulus::Stimulus;
use loadtwin_tests::emulator::Emulator;
use loadtwin_tests::gearbox;

/// Samples of the burst.
const BURST: u16 = 1500;

fn request(record: [u8; 3]) -> Frame {
    let data = single_frame(&[&uds::BURST_ROUTINE[..], &record].concat()).expect("7 bytes");
    let id = uds::REQUEST_ID;
    Frame { id, data }
}

#[test]
fn a_burst_that_the_bus_asks_for_is_proved() {
    let image = gearbox::image();
    let model = Model::from_bytes(&image).expect("good");
    let mut samples = gearbox::samples(4000);
    for (sample, tick) in samples.iter_mut().zip(0..) {
        sample.tick = tick;
    }
    let board = Emulator::start(&image);
    let mut bus = board.bus();
    let mut sensors = board.sensors();
    let rest = samples.split_off(600);
    // The board takes no more than its bus carries away.
    let before = thread::spawn(move || {
        for sample in samples {
            sensors.send(&Stimulus::Sample(sample));
        }
        sensors
    });
    let [high, low] = BURST.to_be_bytes();
    let mut frames = Vec::new();
    // No share, no samples: refused as out of range; then the burst.
    for (record, answer) in [
        ([high, low, 0], [0x03, 0x7F, 0x31, 0x31]),
        ([0, 0, 50], [0x03, 0x7F, 0x31, 0x31]),
        ([high, low, 100], [0x04, 0x71, 0x01, 0x02]),
    ] {
        bus.send(&request(record));
        loop {
            let frame = bus.next().expect("the board runs");
            if frame.id == uds::ANSWER_ID {
                assert_eq!(frame.data[..4], answer);
                break;
            }
            frames.push(frame);
        }
    }
    // The samples that were sent before may belong to either estimator.
    let sent = thread::spawn(move || before.join().unwrap().send_all(rest).join());
    frames.extend(bus);
    let end = board.end(Duration::from_secs(20));
    assert!(end.status.success(), "{}\n{}", end.status, end.log);
    sent.join().unwrap().unwrap();

    let mut comparison = Comparison::new(model).expect("a good model");
    for frame in frames {
        comparison.take(&Received {
            t_us: 0,
            frame: to_bus(&frame),
        });
    }
    let figures = comparison.figures();
    assert_eq!(comparison.verdict(true), Verdict::Identical, "{figures:#?}");
    assert_eq!(
        (figures.bursts, figures.dropped_bursts, figures.samples),
        (1, 0, BURST.into())
    );
    assert!(figures.outside_frames > 0 && figures.compared_frames >= BURST.into());
}
