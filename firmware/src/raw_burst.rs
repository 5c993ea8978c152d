//! Bursts of raw samples (`Burst`), by which a host recomputes the estimates of a board: the queue
//! from the sample clock (`RawWriter`) to the bus (`RawReader`), which takes a share of the bus.
//!
//! A burst begins with the estimator, whose state is known then. Its samples wait in a queue of
//! bytes until the bus has time: where the bus carries them as fast as they come, a burst is as
//! long as was asked for, elsewhere as long as the queue holds. When the queue overflows, the
//! burst ends and what waits is dropped. Frames of estimates have a queue of their own and go first.

use core::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, Ordering::Relaxed};

use heapless::Vec;
use heapless::spsc::{Consumer, Producer};
use loadtwin_common::io::frame::{FdFrame, Frame, raw_fd_frame, raw_frames};
use loadtwin_common::io::raw::{MAX_CHANNELS, MAX_ENCODERS, RawSample};

use crate::board_counters::count;

/// Bit of a record's validity: an index pulse came.
const HAS_INDEX: u16 = 1 << 15;

/// Bus time of a classic frame of 8 bytes with all its stuff bits: 135 bits at 500 kbit/s [us].
const CLASSIC_US: u32 = 270;

/// Bus time of an FD frame of 64 bytes with all its stuff bits: 36 bits at 500 kbit/s, 680 at
/// 2 Mbit/s [us].
const FD_US: u32 = 412;

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Burst {
    /// Samples, 1 to 65534.
    pub samples: u16,
    /// Share of the bus that they take (%), 1 to 100.
    pub share_percent: u8,
    /// As FD frames.
    pub fd: bool,
}

impl Burst {
    /// The burst of the option record of a request: samples (2 bytes, high first), share (%) with
    /// bit 7 for FD.
    pub fn from_request(record: &[u8]) -> Option<Self> {
        let &[high, low, share] = record else {
            return None;
        };
        let burst = Self {
            samples: u16::from_be_bytes([high, low]),
            share_percent: share & 0x7F,
            fd: share & 0x80 != 0,
        };
        let is_allowed =
            (1..u16::MAX).contains(&burst.samples) && (1..=100).contains(&burst.share_percent);
        is_allowed.then_some(burst)
    }
}

/// What both ends of the queue share.
#[derive(Debug, Default)]
pub struct RawLink {
    fd: AtomicBool,
    share_percent: AtomicU8,
    /// The record to come is of tick 0.
    begins: AtomicBool,
    /// What waits in the queue is not to be sent.
    is_dropped: AtomicBool,
    /// Bursts that ended before their last sample.
    dropped: AtomicU32,
}

impl RawLink {
    /// For a `static`.
    pub const fn new() -> Self {
        Self {
            fd: AtomicBool::new(false),
            share_percent: AtomicU8::new(0),
            begins: AtomicBool::new(false),
            is_dropped: AtomicBool::new(false),
            dropped: AtomicU32::new(0),
        }
    }
}

/// The end at the sample clock.
pub struct RawWriter<'a> {
    link: &'a RawLink,
    queue: Producer<'a, u8>,
    next: u32,
    left: u16,
}

impl<'a> RawWriter<'a> {
    /// Before the first burst.
    pub fn new(link: &'a RawLink, queue: Producer<'a, u8>) -> Self {
        Self {
            link,
            queue,
            next: 0,
            left: 0,
        }
    }

    /// Begins a burst with the next sample, of tick 0; `false` while another one is under way.
    pub fn begin(&mut self, burst: Burst) -> bool {
        if self.left > 0 || !self.queue.is_empty() || self.link.is_dropped.load(Relaxed) {
            return false;
        }
        self.link.fd.store(burst.fd, Relaxed);
        self.link.share_percent.store(burst.share_percent, Relaxed);
        self.link.begins.store(true, Relaxed);
        self.next = 0;
        self.left = burst.samples;
        true
    }

    /// Takes a sample, where a burst is under way.
    pub fn take(&mut self, sample: &RawSample) {
        if self.left == 0 {
            return;
        }
        let valid = sample.valid & ((1 << (MAX_CHANNELS + MAX_ENCODERS)) - 1);
        let has_index = sample.index.is_some();
        let flags = valid | if has_index { HAS_INDEX } else { 0 };
        let room = self.queue.capacity() - self.queue.len();
        // Samples between which one is missing would have other ticks at the other end.
        if sample.tick != self.next || room < 2 + 4 * flags.count_ones() as usize {
            self.left = 0;
            self.link.is_dropped.store(true, Relaxed);
            count(&self.link.dropped);
            return;
        }
        self.push(&flags.to_le_bytes());
        for (i, word) in sample.words.iter().enumerate() {
            if sample.has_word(i) {
                self.push(&word.to_le_bytes());
            }
        }
        for (k, count) in sample.encoders.iter().enumerate() {
            if sample.has_encoder(k) {
                self.push(&count.to_le_bytes());
            }
        }
        if let Some(index) = sample.index {
            self.push(&index.to_le_bytes());
        }
        self.next += 1;
        self.left -= 1;
    }

    fn push(&mut self, bytes: &[u8]) {
        for byte in bytes {
            // There is room: it was asked for before the record.
            let _ = self.queue.enqueue(*byte);
        }
    }

    /// Bursts dropped since the start; wraps.
    pub fn dropped(&self) -> u32 {
        self.link.dropped.load(Relaxed)
    }
}

/// A frame of a raw sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RawFrame {
    /// One of up to seven.
    Classic(Frame),
    /// A whole sample.
    Fd(FdFrame),
}

/// The end at the bus, below the sample clock.
pub struct RawReader<'a> {
    link: &'a RawLink,
    queue: Consumer<'a, u8>,
    base: u16,
    tick: u32,
    /// Validity of the record under way.
    flags: Option<u16>,
    /// Frames of the sample under way, the next one last.
    frames: Vec<Frame, 7>,
    /// When the share of the bus allows the next sample [us].
    due_us: u32,
}

impl<'a> RawReader<'a> {
    /// For the machine with this first identifier.
    pub fn new(link: &'a RawLink, queue: Consumer<'a, u8>, base: u16) -> Self {
        Self {
            link,
            queue,
            base,
            tick: 0,
            flags: None,
            frames: Vec::new(),
            due_us: 0,
        }
    }

    /// Whether nothing waits for the bus.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty() && self.queue.is_empty()
    }

    /// The next frame, where one is due; to be asked when nothing else is to be sent.
    pub fn next(&mut self, now_us: u32) -> Option<RawFrame> {
        if self.link.is_dropped.load(Relaxed) {
            while self.queue.dequeue().is_some() {}
            self.frames.clear();
            self.flags = None;
            self.link.is_dropped.store(false, Relaxed);
            return None;
        }
        if let Some(frame) = self.frames.pop() {
            return Some(RawFrame::Classic(frame));
        }
        if self.queue.is_empty() {
            return None;
        }
        if self.link.begins.swap(false, Relaxed) {
            self.tick = 0;
            self.due_us = now_us;
        }
        if now_us.wrapping_sub(self.due_us) > u32::MAX / 2 {
            return None;
        }
        let sample = self.sample()?;
        let fd = self.link.fd.load(Relaxed);
        let busy_us = if fd {
            FD_US
        } else {
            raw_frames(self.base, &sample, |frame| {
                let _ = self.frames.push(frame);
            });
            self.frames.reverse();
            CLASSIC_US * self.frames.len() as u32
        };
        let share = u32::from(self.link.share_percent.load(Relaxed)).max(1);
        // A sample that was late is not made up for: the share holds at any time.
        self.due_us = now_us.wrapping_add(busy_us * 100 / share);
        if fd {
            return Some(RawFrame::Fd(raw_fd_frame(self.base, &sample)));
        }
        self.frames.pop().map(RawFrame::Classic)
    }

    /// The next sample, where its record is whole: the writer may be in the middle of it.
    fn sample(&mut self) -> Option<RawSample> {
        if self.flags.is_none() && self.queue.len() >= 2 {
            self.flags = Some(u16::from_le_bytes(self.bytes()));
        }
        let flags = self.flags?;
        if self.queue.len() < 4 * flags.count_ones() as usize {
            return None;
        }
        self.flags = None;
        let mut sample = RawSample {
            tick: self.tick,
            ..RawSample::default()
        };
        self.tick += 1;
        for i in 0..MAX_CHANNELS {
            if flags & 1 << i != 0 {
                sample.set_word(i, i32::from_le_bytes(self.bytes()));
            }
        }
        for k in 0..MAX_ENCODERS {
            if flags & 1 << (MAX_CHANNELS + k) != 0 {
                sample.set_encoder(k, u32::from_le_bytes(self.bytes()));
            }
        }
        if flags & HAS_INDEX != 0 {
            sample.index = Some(u32::from_le_bytes(self.bytes()));
        }
        Some(sample)
    }

    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        [(); N].map(|()| self.queue.dequeue().unwrap_or_default())
    }
}
