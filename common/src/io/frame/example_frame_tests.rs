//! Test that the frame encoder sends the example frames of `docs/wire-format.md` byte for byte.

use core::fmt::Write;

use crate::io::estimate::{Estimate, LoadEstimate, SensorEstimate};
use crate::io::fault::Fault;
use crate::io::frame::{BoardInfo, BoardPage, FrameEncoder, RawOutput, State, Status};
use crate::io::raw::RawSample;

const SPECIFICATION: &str = include_str!("../../../../docs/wire-format.md");

fn examples() -> impl Iterator<Item = &'static str> {
    let is_frame = |line: &&str| line.get(3..4) == Some("#");
    SPECIFICATION.lines().filter(is_frame)
}

fn candump(id: u16, data: &[u8]) -> heapless::String<132> {
    let mut text = heapless::String::new();
    write!(text, "{id:03X}#").expect("room");
    for byte in data {
        write!(text, "{byte:02X}").expect("room");
    }
    text
}

fn load(value: f32, std: f32, fault: Fault, age: u16) -> LoadEstimate {
    LoadEstimate {
        value,
        std,
        age,
        fault,
    }
}

#[test]
fn the_examples_of_the_specification_are_what_is_sent() {
    let mut encoder =
        FrameEncoder::try_new(0x500, 500.0, [2000.0, 100.0], 0x89AB_CDEF).expect("good");
    let mut frames = heapless::Vec::<heapless::String<132>, 32>::new();
    let mut keep = |id: u16, data: &[u8]| frames.push(candump(id, data)).expect("room");

    let mut estimate = Estimate {
        tick: 258,
        homed: true,
        ..Estimate::default()
    };
    for sample in [
        [
            load(1000.0, 10.0, Fault::None, 0),
            load(-12.5, 0.02, Fault::Stuck, 20),
        ],
        [
            load(f32::NAN, f32::INFINITY, Fault::None, u16::MAX),
            load(1e9, 1e9, Fault::None, 15),
        ],
    ] {
        estimate.loads = sample.into_iter().collect();
        encoder.estimate(&estimate, |frame| keep(frame.id, &frame.data));
        estimate.tick += 1;
    }

    let sensor = SensorEstimate {
        innovation: -3e-6,
        innovation_variance: 4e-12,
        nis: 2.25,
        ..SensorEstimate::default()
    };
    let sensors = [sensor; 3].into_iter().collect();
    let estimate = Estimate {
        tick: 264,
        homed: true,
        sensors,
        ..Estimate::default()
    };
    encoder.estimate(&estimate, |frame| keep(frame.id, &frame.data));

    let status = Status {
        state: State::Running,
        tick: 259,
        overruns: 1,
        missed: 65_536,
        bus_off: 2,
        queue_overflow: 3,
        refused: 0xF8,
        sensors: 3,
    };
    for _ in 0..6 {
        let frame = encoder.status(&status);
        keep(frame.id, &frame.data);
    }

    let mut raw = RawSample {
        tick: 258,
        index: Some(0xFFFF_FFEE),
        ..RawSample::default()
    };
    raw.set_word(0, -8_388_608);
    raw.set_word(1, 1);
    raw.set_encoder(0, 0xFFFF_FFF0);
    encoder.raw(&raw, |frame| keep(frame.id, &frame.data));
    let frame = encoder.raw_fd(&raw);
    keep(frame.id, &frame.data);

    let info = BoardInfo {
        firmware: [0, 1, 0],
        raw: RawOutput::Burst(4000),
        dropped_bursts: 2,
    };
    for page in [BoardPage::Firmware, BoardPage::Raw] {
        let frame = encoder.board_page(&info, page);
        keep(frame.id, &frame.data);
    }

    assert_eq!(frames.len(), examples().count());
    for (ours, theirs) in frames.iter().zip(examples()) {
        assert_eq!(ours.as_str(), theirs);
    }
}
