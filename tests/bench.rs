//! `Bench`, a board on the host whose converter, clock and bus a test controls.

use std::collections::VecDeque;

use loadtwin_common::counting::CountSample;
use loadtwin_common::io::frame::Frame;
use loadtwin_common::io::raw::RawSample;
use loadtwin_firmware::board::Board;
use loadtwin_firmware::board_counters::Counters;
use loadtwin_firmware::raw_burst::RawWriter;

/// The board.
pub struct Bench {
    /// What the converter latched.
    pub sample: Option<RawSample>,
    /// Whether data-ready comes again before a step has ended.
    pub late: bool,
    /// Frames that wait for the bus.
    pub outbox: VecDeque<Frame>,
    /// Where bursts of raw samples wait.
    pub raw: Option<RawWriter<'static>>,
    /// Samples of the counted loads.
    pub counted: Vec<CountSample>,
    /// What its parts count.
    pub counters: Counters,
    room: usize,
}

impl Bench {
    /// A board whose queue to the bus takes so many frames.
    pub fn with_room_for(frames: usize) -> Self {
        Self {
            sample: None,
            late: false,
            outbox: VecDeque::new(),
            raw: None,
            counted: Vec::new(),
            counters: Counters::new(),
            room: frames,
        }
    }
}

impl Board for Bench {
    fn acquire(&mut self) -> Option<RawSample> {
        self.sample.take()
    }

    fn queue(&mut self, frame: Frame) -> Result<(), Frame> {
        if self.outbox.len() >= self.room {
            return Err(frame);
        }
        self.outbox.push_back(frame);
        Ok(())
    }

    fn count(&mut self, sample: CountSample) {
        self.counted.push(sample);
    }

    fn overrun(&mut self) -> bool {
        self.late
    }

    fn raw_writer(&mut self) -> Option<&mut RawWriter<'static>> {
        self.raw.as_mut()
    }

    fn counters(&self) -> &Counters {
        &self.counters
    }
}
