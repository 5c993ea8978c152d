//! Runs the estimator of a model image on a board (`App`): at each data-ready takes a raw sample,
//! steps, hands on the counted loads, and queues the CAN frames of the estimate, of the status with
//! the board's counters, and of the raw sample where that is asked for (`sends_raw`). Without a
//! usable image there are no estimates.

use core::sync::atomic::Ordering::Relaxed;

use loadtwin_common::Error;
use loadtwin_common::counting::LoadSampler;
use loadtwin_common::estimator::Estimator;
use loadtwin_common::hardware::Sampling;
use loadtwin_common::image::Image;
use loadtwin_common::io::estimate::Estimate;
use loadtwin_common::io::frame::{
    BoardInfo, BoardPage, Frame, FrameEncoder, RawOutput, State, Status,
};
use loadtwin_common::io::raw::{MAX_CHANNELS, RawSample};

use crate::board::Board;
use crate::board_counters::{Counters, count};
use crate::raw_burst::Burst;

/// Most frames that one data-ready queues: a raw sample, the loads, a sensor,
/// the status, a page about the board.
pub const MAX_FRAMES: usize = 7 + loadtwin_common::io::estimate::MAX_LOADS + 1 + 1 + 1;

/// Version of the firmware: that of the package.
const FIRMWARE: [u8; 3] = [
    number(env!("CARGO_PKG_VERSION_MAJOR")),
    number(env!("CARGO_PKG_VERSION_MINOR")),
    number(env!("CARGO_PKG_VERSION_PATCH")),
];

/// The number that the digits are.
const fn number(digits: &str) -> u8 {
    match u8::from_str_radix(digits, 10) {
        Ok(number) => number,
        Err(_) => panic!("a part of the version is above 255"),
    }
}

/// The estimator of one machine and the frames it sends.
///
/// Load and sensor frames are the same on every board that gets the same image
/// and the same samples; status frames report what happened on this board.
#[derive(Debug)]
pub struct App<'a> {
    line: Option<Estimator<'a>>,
    encoder: FrameEncoder,
    status: Status,
    /// The image that runs, and its name.
    image: Option<(&'a [u8], u32)>,
    /// Tick of the board at tick 0 of the estimator; not yet known after it began anew.
    first_tick: Option<u32>,
    raw: RawOutput,
    sampling: Sampling,
    sampler: LoadSampler,
    /// Whether the raw samples are sent too, so that somebody on the bus can
    /// recompute the estimates.
    pub sends_raw: bool,
}

impl<'a> App<'a> {
    /// The application with the model of `image`, before its first sample;
    /// `image_hash` names the image in status frames.
    ///
    /// # Errors
    /// Why the image is refused.
    pub fn try_new(image: &'a [u8], image_hash: u32) -> Result<Self, Error> {
        let mut app = Self::without_image();
        app.load(image, image_hash)?;
        Ok(app)
    }

    /// The application of a board without a usable image: it sends status frames only.
    pub const fn without_image() -> Self {
        Self {
            line: None,
            encoder: FrameEncoder::without_image(),
            status: Status::new(),
            image: None,
            first_tick: Some(0),
            raw: RawOutput::None,
            sampling: Sampling {
                rate_hz: 1000.0,
                gains: [None; MAX_CHANNELS],
                counter_bits: None,
            },
            sampler: LoadSampler::new(),
            sends_raw: false,
        }
    }

    /// Takes the model of `image`, as [`Self::try_new`], in place: an application
    /// is large, and a copy of it would be the largest thing on the stack.
    ///
    /// # Errors
    /// Why the image is refused; the application is as it was then.
    pub fn load(&mut self, image: &'a [u8], image_hash: u32) -> Result<(), Error> {
        Image::from_bytes(image).and_then(|image| self.take(image, image_hash))?;
        self.image = Some((image, image_hash));
        Ok(())
    }

    /// Begins a burst of raw samples, and the estimator anew, so that a host knows its state: the
    /// next sample is that of tick 0. Not from the sample clock: it takes as long as a start.
    ///
    /// While another burst is under way, or without an image, nothing changes.
    pub fn begin_burst(&mut self, burst: Burst, board: &mut impl Board) {
        let Some((image, image_hash)) = self.image else {
            return;
        };
        if !board.raw_writer().is_some_and(|raw| raw.begin(burst)) {
            return;
        }
        // It was taken before.
        if self.load(image, image_hash).is_err() {
            return;
        }
        self.first_tick = None;
        self.raw = RawOutput::Burst(burst.samples);
        self.announce(board);
        let info = self.info(board);
        let frame = self.encoder.board_page(&info, BoardPage::Raw);
        queue(board, frame);
    }

    fn info(&self, board: &mut impl Board) -> BoardInfo {
        BoardInfo {
            firmware: FIRMWARE,
            raw: if self.sends_raw {
                RawOutput::All
            } else {
                self.raw
            },
            dropped_bursts: board.raw_writer().map_or(0, |raw| raw.dropped()),
        }
    }

    #[inline(never)]
    fn take(&mut self, image: Image<'a>, image_hash: u32) -> Result<(), Error> {
        let encoder = FrameEncoder::try_build(&image, image_hash)?;
        let sampling = Sampling::of(&image);
        let sampler = LoadSampler::try_new(&image.counted, image.loads().len())?;
        Estimator::build_into(&mut self.line, image)?;
        self.encoder = encoder;
        self.sampling = sampling;
        self.sampler = sampler;
        self.status.state = State::Waiting;
        Ok(())
    }

    /// Rate of the sample clock (Hz), > 0.
    pub fn rate_hz(&self) -> f32 {
        self.sampling.rate_hz
    }

    /// How the image wants its sensors sampled.
    pub fn sampling(&self) -> Sampling {
        self.sampling
    }

    /// First identifier of the machine's frames.
    pub fn base(&self) -> u16 {
        self.encoder.base()
    }

    /// Sets what status frames say of the last image that was offered: the
    /// code of its refusal, or 0.
    pub fn set_refused(&mut self, code: u8) {
        self.status.refused = code;
    }

    /// What status frames say of the last image that was offered.
    pub fn refused(&self) -> u8 {
        self.status.refused
    }

    /// One data-ready: takes the sample, steps, queues the frames.
    ///
    /// What goes wrong around the estimator is counted and never stops it.
    pub fn on_data_ready(&mut self, board: &mut impl Board) {
        let Some(mut raw) = board.acquire() else {
            return;
        };
        let first_tick = *self.first_tick.get_or_insert(raw.tick);
        raw.tick = raw.tick.wrapping_sub(first_tick);
        self.step(&raw, board);
        if board.overrun() {
            count(&board.counters().overruns);
        }
        self.count(board.counters());
        if let Some(frame) = self.encoder.heartbeat(&self.status) {
            queue(board, frame);
        }
        let info = self.info(board);
        if let Some(frame) = self.encoder.about_board(&info) {
            queue(board, frame);
        }
    }

    /// Queues the next page of the status, due or not; for a board whose
    /// converter is silent.
    pub fn announce(&mut self, board: &mut impl Board) {
        self.count(board.counters());
        let frame = self.encoder.status(&self.status);
        queue(board, frame);
    }

    fn step(&mut self, raw: &RawSample, board: &mut impl Board) {
        self.status.tick = raw.tick;
        if self.sends_raw {
            self.encoder.raw(raw, |frame| queue(board, frame));
        }
        if let Some(writer) = board.raw_writer() {
            writer.take(raw);
        }
        let Some(line) = &mut self.line else { return };
        let mut estimate = Estimate::default();
        line.step_into(raw, &mut estimate);
        // The board's own ticks: they go on where the estimator begins anew.
        let tick = raw.tick.wrapping_add(self.first_tick.unwrap_or(0));
        if let Some(sample) = self.sampler.take(tick, &estimate) {
            board.count(sample);
        }
        self.encoder
            .estimate(&estimate, |frame| queue(board, frame));
        board.counters().missed.fetch_add(estimate.lost, Relaxed);
        self.status.sensors = estimate.sensors.len() as u8;
        self.status.state = if estimate.homed {
            State::Running
        } else {
            State::Homing
        };
    }

    fn count(&mut self, counters: &Counters) {
        self.status.overruns = counters.overruns.load(Relaxed);
        self.status.missed = counters.missed.load(Relaxed);
        self.status.bus_off = counters.bus_off.load(Relaxed);
        self.status.queue_overflow = counters.queue_overflow.load(Relaxed);
    }
}

fn queue(board: &mut impl Board, frame: Frame) {
    if board.queue(frame).is_err() {
        count(&board.counters().queue_overflow);
    }
}
