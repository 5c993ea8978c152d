//! Counters of the board in its status frame: overruns, full queue, bus-off; none stops the
//! estimator.

use loadtwin_common::io::frame::{Frame, IDS_PER_MACHINE, Message, Status, decode};
use loadtwin_firmware::app::App;
use loadtwin_firmware::board_counters::BusState;
use loadtwin_tests::bench::Bench;
use loadtwin_tests::gearbox::{image, is_estimate, on_host, samples};

/// As the boards have.
const OUTBOX: usize = 64;
const SAMPLES: u32 = 6000;
/// Ticks at which the controller is off the bus, twice.
const OFF: [std::ops::Range<u32>; 2] = [1000..1500, 3000..3040];

#[test]
fn overruns_a_full_queue_and_bus_off_are_reported_and_stop_nothing() {
    let (image, samples) = (image(), samples(SAMPLES));
    let mut app = App::try_new(&image, 0).unwrap();
    let mut board = Bench::with_room_for(OUTBOX);
    let mut bus = BusState::default();
    let mut status = Status::new();
    let mut sent: Vec<(u32, Frame)> = Vec::new();
    let mut overruns = 0;
    for sample in &samples {
        let off = OFF.iter().any(|off| off.contains(&sample.tick));
        bus.follow(off, &board.counters);
        board.sample = Some(*sample);
        board.late = sample.tick % 100 == 99;
        overruns += u32::from(board.late);
        app.on_data_ready(&mut board);
        if !off {
            sent.extend(board.outbox.drain(..).map(|frame| (sample.tick, frame)));
        }
    }
    for (_, frame) in &sent {
        let base = frame.id / IDS_PER_MACHINE * IDS_PER_MACHINE;
        if let Ok((Message::Status(page, which), _)) = decode(base, frame.id, &frame.data) {
            status.merge(&page, which);
        }
    }
    let mut expected = on_host(&image, &samples, false);
    let all = expected.len();
    let overflow = all - sent.len();
    assert!(overflow > 500, "{overflow} frames had no room");
    // The last pages of the status may be a heartbeat or two old.
    assert!((overruns - 6..=overruns).contains(&status.overruns));
    assert_eq!(status.missed, SAMPLES - samples.len() as u32);
    assert_eq!(status.bus_off, 2);
    assert_eq!(status.queue_overflow, overflow as u32);

    // Whatever was sent is what an undisturbed board says, and after each end
    // of bus-off nothing is missing.
    let after = |from: u32, to: u32| {
        sent.iter()
            .filter(move |(tick, _)| (from..to).contains(tick))
            .map(|(_, frame)| *frame)
            .filter(is_estimate)
    };
    expected.retain(is_estimate);
    let mut rest = expected.iter();
    for frame in after(0, SAMPLES) {
        assert!(rest.any(|e| *e == frame), "{frame:?}");
    }
    let tail: Vec<Frame> = after(OFF[1].end + 1, SAMPLES).collect();
    assert!(tail.len() > 2000 && expected.ends_with(&tail));
}
