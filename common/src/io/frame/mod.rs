//! Encodes estimates, sensor health, status and raw samples of a machine as CAN frames
//! (`FrameEncoder`), and checks and decodes any received frame but those of raw samples (`decode`).
//! Defines identifiers, frame rates and bit fields.
//!
//! `docs/wire-format.md` is the specification, `docs/loadtwin.dbc` the source
//! of the layout. A load or sensor frame is a pure function of the estimate
//! and of its tick: every bit can be recomputed from the raw samples.

mod board_frame;
pub mod e2e;
#[cfg(test)]
mod example_frame_tests;
mod load_frame;
mod raw_frame;
mod sensor_frame;
pub mod signal_layout;
mod status_frame;

use heapless::Vec;

pub use crate::io::frame::board_frame::{BoardInfo, BoardPage, RawOutput};
pub use crate::io::frame::load_frame::LoadFrame;
pub use crate::io::frame::raw_frame::{RawAssembler, RawCounts, raw_fd_frame, raw_frames};
pub use crate::io::frame::sensor_frame::SensorFrame;
pub use crate::io::frame::status_frame::{State, Status, StatusPage};

use crate::Error;
use crate::image::Image;
use crate::io::estimate::{Estimate, MAX_LOADS};
use crate::io::raw::RawSample;

/// Version of the bytes; part of every Data ID, so that frames of another
/// version fail their end-to-end check.
pub const WIRE_VERSION: u16 = 1;

/// Identifier of the first frame where there is no image.
pub const DEFAULT_BASE: u16 = 0x500;

/// Identifiers that one machine takes; the base is a multiple of it.
pub const IDS_PER_MACHINE: u16 = 32;

/// Highest base: above it are the identifiers of image uploads.
pub const MAX_BASE: u16 = 0x7C0;

/// Load frames a second that a machine does not exceed: half of a bus with 500 kbit/s.
const MAX_LOAD_FRAMES_PER_S: f32 = 2000.0;
/// Sensor frames a second that a machine does not exceed.
const MAX_SENSOR_FRAMES_PER_S: f32 = 100.0;
/// Status pages a second: all of them in less than 200 ms.
const STATUS_PAGES_PER_S: f32 = 50.0;

/// A classic frame of 8 bytes with an identifier of 11 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Frame {
    /// Identifier, 0 to 0x7FF.
    pub id: u16,
    /// Payload.
    pub data: [u8; 8],
}

/// An FD frame of 64 bytes with an identifier of 11 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FdFrame {
    /// Identifier, 0 to 0x7FF.
    pub id: u16,
    /// Payload.
    pub data: [u8; 64],
}

/// Where a signal lies in a payload: bits counted from the lowest bit of byte 0.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    /// Lowest bit.
    pub start: u32,
    /// Width (bit), 1 to 32.
    pub bits: u32,
    /// Whether it is two's complement.
    pub signed: bool,
}

impl Field {
    const fn unsigned(start: u32, bits: u32) -> Self {
        Self {
            start,
            bits,
            signed: false,
        }
    }

    const fn signed(start: u32, bits: u32) -> Self {
        Self {
            start,
            bits,
            signed: true,
        }
    }

    const fn mask(self) -> u64 {
        (1 << self.bits) - 1
    }

    /// The lowest bits of `raw` at this place of an 8-byte payload.
    pub const fn put(self, raw: u32) -> u64 {
        (raw as u64 & self.mask()) << self.start
    }

    /// The bits at this place of an 8-byte payload, sign-extended where signed.
    pub const fn get(self, payload: u64) -> u32 {
        let raw = (payload >> self.start & self.mask()) as u32;
        let unused = 32 - self.bits;
        if self.signed {
            ((raw << unused) as i32 >> unused) as u32
        } else {
            raw
        }
    }
}

/// A frame of 8 bytes that passed its checks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Message {
    /// Heartbeat.
    Status(Status, StatusPage),
    /// Load `0..MAX_LOADS`.
    Load(usize, LoadFrame),
    /// Sensor `0..MAX_SENSORS`.
    Sensor(usize, SensorFrame),
    /// One of the frames of a raw sample; [`RawAssembler`] takes it.
    Raw,
    /// What a board says of itself.
    Board(BoardInfo, BoardPage),
}

/// Why a frame was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rejected {
    /// Its identifier is not in the block, or reserved.
    Foreign,
    /// Not the length that its identifier has.
    Length,
    /// The end-to-end CRC does not fit: damaged, of another wire version, or of another sender.
    Check,
    /// The CRC fits but a field has no meaning.
    Content,
}

/// Checks and decodes a classic frame of the machine at `base`; the end-to-end
/// counter comes with it, where the frame has one.
///
/// # Errors
/// Why the frame was not taken.
pub fn decode(base: u16, id: u16, data: &[u8]) -> Result<(Message, Option<u8>), Rejected> {
    let offset = id.wrapping_sub(base);
    if !matches!(
        offset,
        signal_layout::status::OFFSET
            ..=signal_layout::raw_index::OFFSET | signal_layout::board::OFFSET
    ) {
        return Err(Rejected::Foreign);
    }
    let data: [u8; 8] = data.try_into().map_err(|_| Rejected::Length)?;
    if (signal_layout::raw_head::OFFSET..=signal_layout::raw_index::OFFSET).contains(&offset) {
        return Ok((Message::Raw, None));
    }
    let counter = e2e::check(e2e::data_id(id), &data).ok_or(Rejected::Check)?;
    let payload = u64::from_le_bytes(data);
    let message = match offset {
        signal_layout::status::OFFSET => {
            Status::decode(payload).map(|(s, page)| Message::Status(s, page))
        }
        signal_layout::sensor_health::OFFSET => {
            SensorFrame::decode(payload).map(|(k, frame)| Message::Sensor(k, frame))
        }
        signal_layout::board::OFFSET => {
            BoardInfo::decode(payload).map(|(info, page)| Message::Board(info, page))
        }
        _ => LoadFrame::decode(payload)
            .map(|frame| Message::Load(usize::from(offset - signal_layout::load::OFFSET), frame)),
    };
    Ok((message.ok_or(Rejected::Content)?, Some(counter)))
}

/// The frame of an 8-byte payload, with CRC and counter in its first three bytes.
fn protected(id: u16, counter: u8, payload: u64) -> Frame {
    let mut data = payload.to_le_bytes();
    e2e::protect(e2e::data_id(id), counter, &mut data);
    Frame { id, data }
}

/// Which of the samples a kind of frame is sent for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Decimation {
    /// Ticks that are a multiple of `2^log2`.
    log2: u32,
}

impl Decimation {
    /// The shortest power of two that keeps `rate_hz` at or under `most`.
    fn at_most(most: f32, rate_hz: f32) -> Self {
        let (mut log2, mut rate_hz) = (0, rate_hz);
        while rate_hz > most && log2 < 15 {
            rate_hz *= 0.5;
            log2 += 1;
        }
        Self { log2 }
    }

    /// How many frames were due before the one for this tick; `None` when none is due.
    fn number(self, tick: u32) -> Option<u32> {
        let number = tick >> self.log2;
        (number << self.log2 == tick).then_some(number)
    }
}

/// Makes the frames of one machine.
#[derive(Clone, Debug)]
pub struct FrameEncoder {
    base: u16,
    scales: Vec<load_frame::Scale, MAX_LOADS>,
    loads_every: Decimation,
    sensors_every: Decimation,
    status_every: u32,
    since_status: u32,
    status: status_frame::Pages,
    board: BoardFrames,
}

/// When a board says what it is.
#[derive(Clone, Copy, Debug)]
struct BoardFrames {
    counter: u8,
    /// Samples from one page to the next: half a second.
    every: u32,
    since: u32,
    says_raw: bool,
}

impl BoardFrames {
    const fn every(every: u32) -> Self {
        Self {
            counter: 0,
            every,
            since: 0,
            says_raw: false,
        }
    }
}

impl FrameEncoder {
    /// The encoder of the machine of `image`; `image_hash` names the image in
    /// status frames.
    ///
    /// # Errors
    /// `OutOfRange("can_base")` unless it is a multiple of 32 up to 0x7C0;
    /// `NotPositive("full_scale")`, `NotPositive("rate_hz")`.
    pub fn try_build(image: &Image, image_hash: u32) -> Result<Self, Error> {
        Self::try_new(
            image.can_base,
            image.rate_hz,
            image.loads().iter().map(|load| load.full_scale),
            image_hash,
        )
    }

    /// An encoder from its parts: base identifier, sample rate (Hz), load at
    /// full scale of each load [N m, N], hash of the image.
    ///
    /// # Errors
    /// As [`FrameEncoder::try_build`]; `OutOfRange("loads")` for more than [`MAX_LOADS`].
    pub fn try_new(
        base: u16,
        rate_hz: f32,
        full_scales: impl IntoIterator<Item = f32>,
        image_hash: u32,
    ) -> Result<Self, Error> {
        if base > MAX_BASE || !base.is_multiple_of(IDS_PER_MACHINE) {
            return Err(Error::OutOfRange("can_base"));
        }
        if !(rate_hz > 0.0 && rate_hz.is_finite()) {
            return Err(Error::NotPositive("rate_hz"));
        }
        let mut scales = Vec::new();
        for full_scale in full_scales {
            let scale = load_frame::Scale::try_new(full_scale)?;
            scales.push(scale).map_err(|_| Error::OutOfRange("loads"))?;
        }
        let loads_every = Decimation::at_most(MAX_LOAD_FRAMES_PER_S, rate_hz * scales.len() as f32);
        let sensors_every = Decimation::at_most(MAX_SENSOR_FRAMES_PER_S, rate_hz);
        Ok(Self {
            base,
            loads_every,
            sensors_every,
            status_every: libm::fmaxf(libm::rintf(rate_hz / STATUS_PAGES_PER_S), 1.0) as u32,
            since_status: 0,
            board: BoardFrames::every(libm::fmaxf(libm::rintf(0.5 * rate_hz), 1.0) as u32),
            status: status_frame::Pages {
                counter: 0,
                page: 0,
                image_hash,
                loads: scales.len() as u32,
                load_every: loads_every.log2,
                sensor_every: sensors_every.log2,
                rate_mhz: libm::rintf(rate_hz * 1000.0) as u32,
            },
            scales,
        })
    }

    /// The encoder of a board without a usable image: it sends status frames only.
    pub const fn without_image() -> Self {
        Self {
            base: DEFAULT_BASE,
            scales: Vec::new(),
            loads_every: Decimation { log2: 0 },
            sensors_every: Decimation { log2: 0 },
            status_every: 1,
            since_status: 0,
            board: BoardFrames::every(500),
            status: status_frame::Pages::new(),
        }
    }

    /// First identifier of the machine's block.
    pub fn base(&self) -> u16 {
        self.base
    }

    /// Load frames come for every sample whose tick is a multiple of 2 to this power.
    pub fn load_every_log2(&self) -> u32 {
        self.loads_every.log2
    }

    /// Sensor frames come for every sample whose tick is a multiple of 2 to this power.
    pub fn sensor_every_log2(&self) -> u32 {
        self.sensors_every.log2
    }

    /// The load and sensor frames that are due for this estimate, in the order
    /// in which they go on the bus.
    pub fn estimate(&self, estimate: &Estimate, mut send: impl FnMut(Frame)) {
        if let Some(number) = self.loads_every.number(estimate.tick) {
            let first = self.base + signal_layout::load::OFFSET;
            for ((id, load), scale) in (first..).zip(&estimate.loads).zip(&self.scales) {
                let payload = LoadFrame::of(load, *scale).encode();
                send(protected(id, number as u8, payload));
            }
        }
        if let Some(number) = self.sensors_every.number(estimate.tick) {
            let which = number
                .checked_rem(estimate.sensors.len() as u32)
                .unwrap_or(0);
            if let Some(sensor) = estimate.sensors.get(which as usize) {
                let payload = SensorFrame::of(sensor, estimate.homed).encode(which);
                let id = self.base + signal_layout::sensor_health::OFFSET;
                send(protected(id, number as u8, payload));
            }
        }
    }

    /// To be asked once a sample: the next page of the status, when one is due.
    pub fn heartbeat(&mut self, status: &Status) -> Option<Frame> {
        self.since_status = self.since_status.saturating_add(1);
        (self.since_status >= self.status_every).then(|| self.status(status))
    }

    /// The next page of the status, due or not.
    pub fn status(&mut self, status: &Status) -> Frame {
        self.since_status = 0;
        let (counter, payload) = self.status.next(status);
        protected(self.base + signal_layout::status::OFFSET, counter, payload)
    }

    /// To be asked once a sample by a board: the page about it that is due, two a second in turn.
    pub fn about_board(&mut self, info: &BoardInfo) -> Option<Frame> {
        self.board.since = self.board.since.saturating_add(1);
        (self.board.since >= self.board.every).then(|| {
            self.board.since = 0;
            let says_raw = self.board.says_raw;
            self.board.says_raw = !says_raw;
            let page = if says_raw {
                BoardPage::Raw
            } else {
                BoardPage::Firmware
            };
            self.board_page(info, page)
        })
    }

    /// A page about the board, due or not.
    pub fn board_page(&mut self, info: &BoardInfo, page: BoardPage) -> Frame {
        let counter = self.board.counter;
        self.board.counter = counter.wrapping_add(1);
        let id = self.base + signal_layout::board::OFFSET;
        protected(id, counter, info.encode(page))
    }

    /// The classic frames of a raw sample, 1 to 7.
    pub fn raw(&self, sample: &RawSample, send: impl FnMut(Frame)) {
        raw_frames(self.base, sample, send);
    }

    /// The FD frame of a raw sample.
    pub fn raw_fd(&self, sample: &RawSample) -> FdFrame {
        raw_fd_frame(self.base, sample)
    }
}
