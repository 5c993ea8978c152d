//! Encodes a raw sample as classic or FD frames, bit for bit, and assembles whole samples from
//! received frames (`RawAssembler`), with counts of lost and damaged ones.
//!
//! Classic: a head with tick and validity, then, in the order of their
//! identifiers, the frames in which something was delivered. One CRC over the
//! whole sample stands in the head, so that frames of two samples cannot make
//! one. FD: one frame of 64 bytes.

use crate::io::frame::e2e;
use crate::io::frame::e2e::Check;
use crate::io::frame::{FdFrame, Field, Frame, signal_layout};
use crate::io::raw::{MAX_CHANNELS, MAX_ENCODERS, RawSample};

/// Bits of `RawSample::valid` that mean something.
const VALID: u16 = (1 << (MAX_CHANNELS + MAX_ENCODERS)) - 1;

/// Frames after the head: four with words, encoders, index.
const PARTS: usize = 6;

/// Which parts a sample has, by bits.
fn parts_of(valid: u16, has_index: bool) -> u8 {
    let words = |pair: u16| u8::from(valid >> (2 * pair) & 3 != 0);
    words(0)
        | words(1) << 1
        | words(2) << 2
        | words(3) << 3
        | u8::from(valid >> MAX_CHANNELS != 0) << 4
        | u8::from(has_index) << 5
}

/// The sample without what was not delivered.
fn delivered(sample: &RawSample) -> RawSample {
    let mut clean = RawSample {
        valid: sample.valid & VALID,
        ..*sample
    };
    for (i, word) in clean.words.iter_mut().enumerate() {
        if !sample.has_word(i) {
            *word = 0;
        }
    }
    for (k, count) in clean.encoders.iter_mut().enumerate() {
        if !sample.has_encoder(k) {
            *count = 0;
        }
    }
    clean
}

fn pair(low: u32, high: u32) -> u64 {
    u64::from(low) | u64::from(high) << 32
}

fn payloads(sample: &RawSample) -> [u64; PARTS] {
    let [w0, w1, w2, w3, w4, w5, w6, w7] = sample.words.map(|word| word as u32);
    let [e0, e1] = sample.encoders;
    let index = sample.index.unwrap_or(0);
    [
        pair(w0, w1),
        pair(w2, w3),
        pair(w4, w5),
        pair(w6, w7),
        pair(e0, e1),
        pair(index, 0),
    ]
}

fn assemble(tick: u32, valid: u16, has_index: bool, parts: [u64; PARTS]) -> RawSample {
    let halves = parts.map(|part| (part as u32, (part >> 32) as u32));
    let [(w0, w1), (w2, w3), (w4, w5), (w6, w7), (e0, e1), (index, _)] = halves;
    let sample = RawSample {
        tick,
        valid,
        words: [w0, w1, w2, w3, w4, w5, w6, w7].map(|word| word as i32),
        encoders: [e0, e1],
        index: has_index.then_some(index),
    };
    delivered(&sample)
}

/// CRC over the head after its CRC and the parts that are there.
fn sample_crc(id: u16, head: u64, parts: u8, payloads: &[u64; PARTS]) -> u16 {
    let [_, _, after @ ..] = head.to_le_bytes();
    let mut check = Check::new().with(&after);
    for (i, payload) in payloads.iter().enumerate() {
        if parts & 1 << i != 0 {
            check = check.with(&payload.to_le_bytes());
        }
    }
    check.finish(e2e::data_id(id))
}

/// The classic frames of a raw sample of the machine at `base`, 1 to 7.
pub fn raw_frames(base: u16, sample: &RawSample, mut send: impl FnMut(Frame)) {
    use signal_layout::raw_head as field;
    let sample = delivered(sample);
    let id = base + field::OFFSET;
    let payloads = payloads(&sample);
    let parts = parts_of(sample.valid, sample.index.is_some());
    let head = field::TICK.put(sample.tick)
        | field::VALID.put(sample.valid.into())
        | field::HAS_INDEX.put(sample.index.is_some().into());
    let crc = sample_crc(id, head, parts, &payloads);
    let head = head | field::SAMPLE_CRC.put(crc.into());
    send(Frame {
        id,
        data: head.to_le_bytes(),
    });
    for (i, payload) in payloads.iter().enumerate() {
        if parts & 1 << i != 0 {
            let id = base + signal_layout::raw_words::OFFSET + i as u16;
            send(Frame {
                id,
                data: payload.to_le_bytes(),
            });
        }
    }
}

/// Where the fields of an FD frame lie: a byte after the other from the tick on.
const FD_BODY: usize = 7;

/// The FD frame of a raw sample of the machine at `base`.
pub fn raw_fd_frame(base: u16, sample: &RawSample) -> FdFrame {
    const {
        // The bytes below follow the layout; a change of the DBC must come here too.
        use signal_layout::raw_fd as field;
        assert!(field::TICK.start == 24 && field::VALID.start as usize == 8 * FD_BODY);
        assert!(field::HAS_INDEX.start == 71 && field::WORD0.start == 72);
        assert!(field::ENCODER0.start == 328 && field::LATCHED.start == 392);
    }
    let sample = delivered(sample);
    let valid = sample.valid | u16::from(sample.index.is_some()) << 15;
    let mut data = [0; 64];
    let bytes = [0; 3]
        .into_iter()
        .chain(sample.tick.to_le_bytes())
        .chain(valid.to_le_bytes())
        .chain(payloads(&sample).into_iter().flat_map(u64::to_le_bytes));
    for (to, byte) in data.iter_mut().zip(bytes) {
        *to = byte;
    }
    let id = base + signal_layout::raw_fd::OFFSET;
    e2e::protect(e2e::data_id(id), sample.tick as u8, &mut data);
    FdFrame { id, data }
}

fn from_fd(id: u16, data: &[u8; 64]) -> Option<RawSample> {
    e2e::check(e2e::data_id(id), data)?;
    let u32_at = |field: Field| {
        let mut value = 0;
        for (i, byte) in data
            .iter()
            .skip(field.start as usize / 8)
            .take(4)
            .enumerate()
        {
            value |= u32::from(*byte) << (8 * i);
        }
        value
    };
    let mut parts = [0; PARTS];
    let mut field = signal_layout::raw_fd::WORD0;
    for part in &mut parts {
        let low = u32_at(field);
        field.start += 32;
        *part = pair(low, u32_at(field));
        field.start += 32;
    }
    let flags = u32_at(signal_layout::raw_fd::VALID) as u16;
    let has_index = flags >> 15 != 0;
    if flags & !(VALID | 1 << 15) != 0 || data[2] != u32_at(signal_layout::raw_fd::TICK) as u8 {
        return None;
    }
    Some(assemble(
        u32_at(signal_layout::raw_fd::TICK),
        flags & VALID,
        has_index,
        parts,
    ))
}

/// Counts of samples and frames by what became of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RawCounts {
    /// Whole samples.
    pub samples: u64,
    /// Samples missing between the ticks of whole ones.
    pub lost: u64,
    /// Samples dropped because a frame of theirs was missing or out of order.
    pub incomplete: u64,
    /// Samples or frames dropped because their CRC or a field was wrong.
    pub damaged: u64,
    /// Frames that belong to no sample.
    pub stray: u64,
    /// Samples whose tick is not ahead of the one before: a restart, or a repetition.
    pub backward: u64,
}

/// Puts raw samples together from their frames.
#[derive(Clone, Copy, Debug)]
pub struct RawAssembler {
    base: u16,
    head: u64,
    expected: u8,
    open: bool,
    payloads: [u64; PARTS],
    last: Option<u32>,
    counts: RawCounts,
}

impl RawAssembler {
    /// For the machine whose identifiers start at `base`.
    pub fn new(base: u16) -> Self {
        Self {
            base,
            head: 0,
            expected: 0,
            open: false,
            payloads: [0; PARTS],
            last: None,
            counts: RawCounts::default(),
        }
    }

    /// The counts so far.
    pub fn counts(&self) -> RawCounts {
        self.counts
    }

    /// Takes a frame of any identifier and length; gives the sample that it
    /// completes. Frames of other kinds are passed over.
    pub fn push(&mut self, id: u16, data: &[u8]) -> Option<RawSample> {
        let offset = id.wrapping_sub(self.base);
        if !matches!(
            offset,
            signal_layout::raw_head::OFFSET..=signal_layout::raw_fd::OFFSET
        ) {
            return None;
        }
        if offset == signal_layout::raw_fd::OFFSET {
            let sample = data.try_into().ok().and_then(|data| from_fd(id, data));
            return self.done(sample);
        }
        let Ok(payload) = data.try_into().map(u64::from_le_bytes) else {
            self.counts.damaged += 1;
            return None;
        };
        if offset == signal_layout::raw_head::OFFSET {
            self.start(payload)
        } else {
            self.part(offset - signal_layout::raw_words::OFFSET, payload)
        }
    }

    fn start(&mut self, head: u64) -> Option<RawSample> {
        use signal_layout::raw_head as field;
        self.counts.incomplete += u64::from(self.open);
        self.head = head;
        self.expected = parts_of(
            field::VALID.get(head) as u16,
            field::HAS_INDEX.get(head) != 0,
        );
        self.open = true;
        self.complete()
    }

    fn part(&mut self, part: u16, payload: u64) -> Option<RawSample> {
        if !self.open {
            self.counts.stray += 1;
            return None;
        }
        if self.expected.trailing_zeros() != u32::from(part) {
            self.open = false;
            self.counts.incomplete += 1;
            self.counts.stray += 1;
            return None;
        }
        if let Some(slot) = self.payloads.get_mut(usize::from(part)) {
            *slot = payload;
        }
        self.expected &= self.expected.wrapping_sub(1);
        self.complete()
    }

    fn complete(&mut self) -> Option<RawSample> {
        use signal_layout::raw_head as field;
        if self.expected != 0 {
            return None;
        }
        self.open = false;
        let (valid, has_index) = (
            field::VALID.get(self.head) as u16,
            field::HAS_INDEX.get(self.head) != 0,
        );
        let parts = parts_of(valid, has_index);
        let id = self.base + field::OFFSET;
        let crc = sample_crc(id, self.head, parts, &self.payloads);
        let fits = u32::from(crc) == field::SAMPLE_CRC.get(self.head);
        let reserved = self.head >> 58 & 0x1F != 0;
        let sample = (fits && !reserved)
            .then(|| assemble(field::TICK.get(self.head), valid, has_index, self.payloads));
        self.done(sample)
    }

    fn done(&mut self, sample: Option<RawSample>) -> Option<RawSample> {
        let Some(sample) = sample else {
            self.counts.damaged += 1;
            return None;
        };
        self.counts.samples += 1;
        if let Some(last) = self.last {
            match sample.tick.wrapping_sub(last) {
                step @ 1..0x8000_0000 => self.counts.lost += u64::from(step - 1),
                _ => self.counts.backward += 1,
            }
        }
        self.last = Some(sample.tick);
        Some(sample)
    }
}

#[cfg(test)]
#[path = "raw_tests.rs"]
mod tests;
