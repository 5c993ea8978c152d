//! Reads the counts of load cycles that a board keeps in flash (`kept_counts`): from its bus by UDS
//! requests over ISO-TP, or from a log of such a reading.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use loadtwin_common::counting::kept::{Area, Header, WORD, Words};
use loadtwin_common::counting::{LoadCounts, MAX_COUNTED, MachineCounts};
use loadtwin_common::io::frame::Frame;
use loadtwin_common::io::isotp::{Received, Receiver, single_frame, single_message};
use loadtwin_common::io::uds;
use thiserror::Error;

use super::bus::{Bus, BusError, Link};
use super::frame_source::Source;
use super::{CanError, standard, to_bus};

/// How long an answer, or the next frame of one, may take: that of ISO-TP.
const PATIENCE: Duration = Duration::from_secs(1);

/// How often a request is sent.
const ATTEMPTS: u8 = 4;

/// Silence after which no late answer to a repeated request is expected.
const SILENCE: Duration = Duration::from_millis(200);

/// Bytes that one request reads.
const BLOCK: u32 = uds::MOST_READ as u32;

/// Most bytes that a board keeps counts in: more than any microcontroller has of flash.
const MOST_BYTES: u32 = 16 << 20;

/// Room for an answer.
const ANSWER: usize = uds::MOST_READ as usize + 1;

/// Why there are no counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum KeptCountsError {
    /// The board does not answer.
    #[error("no answer of a board")]
    NoAnswer,
    /// The board has firmware without counts.
    #[error("the board's firmware keeps no counts")]
    NotServed,
    /// The board answered with another code.
    #[error("the board answered with code {0:#04x}")]
    Answered(u8),
    /// Nothing is there.
    #[error(
        "the board has kept no counts yet; a board with [[count]] in its image keeps them after 50 s of running"
    )]
    None,
    /// A log without a whole reading.
    #[error(
        "the log has no whole reading of the counts; allowed: one that was taken while `life` read the board"
    )]
    NotInLog,
}

/// Counts of the loads of one image.
#[derive(Clone, Debug, PartialEq)]
pub struct KeptPage {
    /// Image, sample rate and loads.
    pub header: Header,
    /// Counts of each load, in the order of the header.
    pub counts: Vec<LoadCounts>,
}

/// Where the areas of kept counts are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Layout {
    areas: u32,
    area_bytes: u32,
}

impl Layout {
    /// That of an answer.
    fn of(message: &[u8]) -> Option<Self> {
        let [service, id @ ..] = uds::COUNTS_LAYOUT;
        let answer = message.strip_prefix(&[service + uds::POSITIVE])?;
        let [areas, high, low] = *answer.strip_prefix(&id)? else {
            return None;
        };
        let area_bytes = u32::from(u16::from_be_bytes([high, low])) * uds::LAYOUT_UNIT;
        let areas = areas.into();
        (area_bytes.checked_mul(areas)? <= MOST_BYTES).then_some(Self { areas, area_bytes })
    }
}

/// The counts that the board on `source` keeps, or whose reading is in its log: a page for each
/// image, the oldest first.
///
/// # Errors
/// When the source cannot be opened, the bus fails for good, the board does not answer or keeps
/// nothing, or the log has no whole reading.
pub fn kept_counts(source: Source<'_>, stop: &AtomicBool) -> Result<Vec<KeptPage>, CanError> {
    let bus = source.open(None, None)?;
    if source.log().is_some() {
        of_log(bus)
    } else {
        of_board(bus, stop)
    }
}

/// The counts of the board on `bus`, as [`kept_counts`].
///
/// # Errors
/// As [`kept_counts`].
pub fn of_board<B: Bus>(bus: B, stop: &AtomicBool) -> Result<Vec<KeptPage>, CanError> {
    let mut board = Board {
        link: Link::new(bus, PATIENCE),
        stop,
        blocks: BTreeMap::new(),
        error: None,
    };
    let layout = Layout::of(&board.request(&uds::COUNTS_LAYOUT)?);
    let layout = layout.ok_or(KeptCountsError::NotServed)?;
    let pages = pages(&mut board, layout);
    match board.error {
        Some(error) => Err(error),
        None if pages.is_empty() => Err(KeptCountsError::None.into()),
        None => Ok(pages),
    }
}

/// The newest counts of each image.
fn pages(memory: &mut impl Words, layout: Layout) -> Vec<KeptPage> {
    let mut pages: Vec<KeptPage> = Vec::new();
    for number in 0..layout.areas {
        let start = number * layout.area_bytes;
        let end = start + layout.area_bytes;
        let area = Area { start, end };
        let Some(header) = area.header(memory) else {
            continue;
        };
        let mut counts = Box::new(MachineCounts::<MAX_COUNTED>::none());
        if area.load(memory, &header, &mut counts).is_ok() {
            counts.loads_mut().iter_mut().for_each(LoadCounts::settle);
            let counts = counts.loads().to_vec();
            pages.push(KeptPage { header, counts });
        }
    }
    pages.sort_by_key(|page| Reverse(page.header.generation));
    let mut images = BTreeSet::new();
    pages.retain(|page| images.insert(page.header.image_hash));
    pages.reverse();
    pages
}

/// The memory of a board on a bus; each block is read once.
struct Board<'a, B> {
    link: Link<B>,
    stop: &'a AtomicBool,
    blocks: BTreeMap<u32, Vec<u8>>,
    error: Option<CanError>,
}

impl<B: Bus> Words for Board<'_, B> {
    fn word(&mut self, at: u32) -> Option<u64> {
        let block = at / BLOCK * BLOCK;
        if self.error.is_none() && !self.blocks.contains_key(&block) {
            match self.read(block) {
                Ok(bytes) => _ = self.blocks.insert(block, bytes),
                Err(error) => self.error = Some(error),
            }
        }
        let bytes = self.blocks.get(&block)?.get((at - block) as usize..)?;
        Some(u64::from_le_bytes(*bytes.first_chunk()?))
    }
}

impl<B: Bus> Board<'_, B> {
    fn read(&mut self, address: u32) -> Result<Vec<u8>, CanError> {
        let [a, b, c, d] = address.to_be_bytes();
        let [service, format] = uds::READ_FORMAT;
        let answer = self.request(&[service, format, a, b, c, d, uds::MOST_READ])?;
        Ok(answer.get(1..).unwrap_or_default().to_vec())
    }

    /// The positive answer to a request.
    fn request(&mut self, request: &[u8]) -> Result<Vec<u8>, CanError> {
        for attempt in 0..ATTEMPTS {
            if self.stop.load(Ordering::Relaxed) {
                return Err(CanError::Stopped);
            }
            self.send(single_frame(request))?;
            let Some(answer) = self.answer(request)? else {
                continue;
            };
            if attempt > 0 {
                self.let_pass()?;
            }
            return Ok(answer);
        }
        Err(KeptCountsError::NoAnswer.into())
    }

    fn send(&mut self, data: Option<[u8; 8]>) -> Result<(), CanError> {
        let id = uds::REQUEST_ID;
        if let Some(data) = data {
            self.link.send(&to_bus(&Frame { id, data }), self.stop)?;
        }
        Ok(())
    }

    /// The answer to a request that was sent; none where there is none in time.
    fn answer(&mut self, request: &[u8]) -> Result<Option<Vec<u8>>, CanError> {
        let service = request.first().copied().unwrap_or_default();
        let mut receiver = Receiver::<ANSWER>::new(0, 0);
        let begin = self.link.bus().now();
        let mut last = begin;
        while self.link.bus().now().saturating_sub(last) < PATIENCE {
            if self.stop.load(Ordering::Relaxed) {
                return Err(CanError::Stopped);
            }
            let received = self.link.receive(SILENCE)?;
            let now = self.link.bus().now();
            let frame = received.as_ref().and_then(|r| standard(&r.frame));
            let Some((uds::ANSWER_ID, data)) = frame else {
                continue;
            };
            last = now;
            match receiver.on_frame(data, now.saturating_sub(begin).as_micros() as u32) {
                Received::Nothing => {}
                Received::Reply(reply) => self.send(Some(reply))?,
                Received::Message => match *receiver.message() {
                    [uds::NEGATIVE, of, code] if of == service => match code {
                        uds::PENDING => {}
                        uds::SERVICE_NOT_SUPPORTED => return Err(KeptCountsError::NotServed.into()),
                        code => return Err(KeptCountsError::Answered(code).into()),
                    },
                    [first, ..] if first == service + uds::POSITIVE => {
                        return Ok(Some(receiver.message().to_vec()));
                    }
                    _ => {}
                },
            }
        }
        Ok(None)
    }

    /// Lets late answers to a request that was repeated pass: an answer does not say its address.
    fn let_pass(&mut self) -> Result<(), CanError> {
        let mut last = self.link.bus().now();
        while self.link.bus().now().saturating_sub(last) < SILENCE {
            let received = self.link.receive(SILENCE)?;
            let frame = received.as_ref().and_then(|r| standard(&r.frame));
            if frame.is_some_and(|(id, _)| id == uds::ANSWER_ID) {
                last = self.link.bus().now();
            }
        }
        Ok(())
    }
}

/// What a log has of a board's memory.
#[derive(Default)]
struct Logged {
    layout: Option<Layout>,
    bytes: BTreeMap<u32, u8>,
    /// Whether a byte was wanted that is not there.
    is_missing: bool,
}

impl Words for Logged {
    fn word(&mut self, at: u32) -> Option<u64> {
        let mut word = [0; WORD];
        for (address, byte) in (at..).zip(&mut word) {
            let Some(found) = self.bytes.get(&address) else {
                self.is_missing = true;
                return None;
            };
            *byte = *found;
        }
        Some(u64::from_le_bytes(word))
    }
}

impl Logged {
    /// Takes the answer to a request.
    fn take(&mut self, request: &[u8], answer: &[u8]) {
        self.layout = Layout::of(answer).or(self.layout);
        let address = request.strip_prefix(&uds::READ_FORMAT);
        let bytes = answer.strip_prefix(&[uds::READ_MEMORY + uds::POSITIVE]);
        if let (Some(&[a, b, c, d, size]), Some(bytes)) = (address, bytes)
            && bytes.len() == usize::from(size)
        {
            let address = u32::from_be_bytes([a, b, c, d]);
            self.bytes.extend((address..).zip(bytes.iter().copied()));
        }
    }
}

fn of_log<B: Bus>(mut bus: B) -> Result<Vec<KeptPage>, CanError> {
    let mut logged = Logged::default();
    let mut request = Vec::new();
    let mut receiver = Receiver::<ANSWER>::new(0, 0);
    loop {
        let received = match bus.receive(SILENCE) {
            Ok(received) => received,
            Err(BusError::Ended) => break,
            Err(error) => return Err(error.into()),
        };
        let Some(received) = received else { continue };
        match standard(&received.frame) {
            Some((uds::REQUEST_ID, data)) => {
                request = single_message(data).map_or(request, <[u8]>::to_vec);
            }
            // Microseconds wrap as the receiver expects.
            Some((uds::ANSWER_ID, data))
                if receiver.on_frame(data, received.t_us as u32) == Received::Message =>
            {
                logged.take(&request, receiver.message());
            }
            _ => {}
        }
    }
    let layout = logged.layout.ok_or(KeptCountsError::NotInLog)?;
    let pages = pages(&mut logged, layout);
    if logged.is_missing {
        return Err(KeptCountsError::NotInLog.into());
    }
    if pages.is_empty() {
        return Err(KeptCountsError::None.into());
    }
    Ok(pages)
}
