//! Receives a model image from the bus by UDS download services over ISO-TP (`Upload`), has the
//! store check and install it page by page, and answers whether it is accepted or why not.
//!
//! [`Upload::on_frame`] belongs where frames are received: it answers with flow
//! control and never blocks. [`Upload::poll`] belongs in the background, below
//! the estimator: it checks the image and installs it.
//!
//! The image is received into memory and checked there as a whole: nothing is
//! erased for one that the [`Store`] does not take. A page is installed in each
//! poll, so that the background goes on with other work between them.
//!
//! Nothing here decides who may upload: the [`Store`] takes what was signed for
//! this board and is newer than the running image, and nothing else.

use embedded_storage::nor_flash::NorFlash;
use loadtwin_common::io::isotp::{FrameData, Received, Receiver, TIMEOUT_US, single_frame};
use loadtwin_common::io::signed_image::ImageError;
use loadtwin_common::io::uds;

use crate::raw_burst::Burst;
use crate::store::Store;

/// What a transfer request adds to a block: service and counter (bytes).
pub const BLOCK_OVERHEAD: usize = 2;

/// Frames that may follow one flow control. Low enough for a receive queue of
/// 16 frames.
const BLOCK_SIZE: u8 = 16;

/// Silence after which an upload makes way for another one [us]: four times as long as a sender
/// waits before it sends a request again, and one second more.
const IDLE_US: u32 = 4 * TIMEOUT_US + 1_000_000;

/// Installations that may fail between two starts. Each erases a slot, of which the flash
/// endures 10 000 (STM32G474, DS12288 table 55); a recorded upload sent again and again to a
/// board with a worn cell would use them up.
const FAILED_INSTALLATIONS: u8 = 3;

/// What became of an upload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// The image of this issue is in force; it starts at the next restart.
    Accepted(u32),
    /// Refused; the running model stays.
    Refused(ImageError),
}

/// What a [`Upload::poll`] led to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    /// Frame to send with [`uds::ANSWER_ID`].
    pub answer: Option<FrameData>,
    /// Whether an image was accepted or refused, for the status frame.
    pub event: Option<Event>,
    /// Raw samples were asked for.
    pub burst: Option<Burst>,
    /// Kept counts were asked for.
    pub asked: Option<Asked>,
}

/// A request about kept counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asked {
    /// Where they are.
    Layout,
    /// A part of their memory.
    Memory {
        /// Offset in that memory.
        address: u32,
        /// Bytes.
        size: u8,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Idle,
    /// Announced; the first block brings the header.
    Announced {
        image_len: u32,
    },
    /// The header in the first block was checked; the block itself waits for room.
    Admitted {
        image_len: u32,
    },
    /// `counter`: of the last block received.
    Transfer {
        counter: u8,
        received: u32,
        image_len: u32,
    },
    /// Checked; pages go into the flash.
    Installing {
        image_len: u32,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Request {
    None,
    /// To be answered "still at work" first.
    Slow,
    Ready,
}

/// Receiving end of an upload. `N`: the flash's page plus [`BLOCK_OVERHEAD`].
#[derive(Clone, Debug)]
pub struct Upload<const N: usize> {
    receiver: Receiver<N>,
    request: Request,
    phase: Phase,
    /// When the last request of the upload was received.
    heard_us: u32,
    failed_installations: u8,
}

impl<const N: usize> Default for Upload<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Upload<N> {
    /// Waits for an upload.
    pub fn new() -> Self {
        Self {
            receiver: Receiver::new(BLOCK_SIZE, 0),
            request: Request::None,
            phase: Phase::Idle,
            heard_us: 0,
            failed_installations: 0,
        }
    }

    /// Whether the upload needs room for its image: from a header on that was signed for this board,
    /// until the upload is over or silent.
    pub fn needs_room(&mut self, now_us: u32) -> bool {
        if self.request == Request::None {
            self.end_if_silent(now_us);
        }
        !matches!(self.phase, Phase::Idle | Phase::Announced { .. })
    }

    /// Takes the data of a frame with [`uds::REQUEST_ID`]; gives the flow
    /// control frame to send with [`uds::ANSWER_ID`].
    ///
    /// While a request is being worked on frames are dropped: the sender waits
    /// for its answer, whoever does not is none.
    pub fn on_frame(&mut self, data: &[u8], now_us: u32) -> Option<FrameData> {
        if self.request != Request::None {
            return None;
        }
        match self.receiver.on_frame(data, now_us) {
            Received::Nothing => None,
            Received::Reply(frame) => {
                self.heard_us = now_us;
                Some(frame)
            }
            Received::Message => {
                self.end_if_silent(now_us);
                // The header's signature and the whole image take longer than
                // the 50 ms within which an answer is due.
                let slow = match self.receiver.message() {
                    [uds::TRANSFER_DATA, ..] => matches!(self.phase, Phase::Announced { .. }),
                    [uds::TRANSFER_EXIT] => true,
                    _ => false,
                };
                self.request = if slow { Request::Slow } else { Request::Ready };
                if self.phase == Phase::Idle || self.is_of_upload() {
                    self.heard_us = now_us;
                }
                None
            }
        }
    }

    /// An upload that is silent is over. One that goes on is not ended by another announcement, see
    /// `announce`.
    fn end_if_silent(&mut self, now_us: u32) {
        if now_us.wrapping_sub(self.heard_us) >= IDLE_US {
            self.phase = Phase::Idle;
        }
    }

    /// Whether the message belongs to the upload under way: other requests do not keep it alive.
    fn is_of_upload(&self) -> bool {
        matches!(
            self.receiver.message(),
            [uds::TRANSFER_DATA | uds::TRANSFER_EXIT, ..]
        )
    }

    /// Works on the request received, if any.
    ///
    /// `room`: holds the image until it is installed; of `longest` bytes, the longest image, where
    /// [`Self::needs_room`]. `accept` checks a payload, as for [`Store::boot`].
    pub fn poll<F: NorFlash>(
        &mut self,
        store: &mut Store<F>,
        room: &mut [u8],
        longest: usize,
        accept: impl FnOnce(&[u8]) -> Result<(), ImageError>,
    ) -> Progress {
        const {
            assert!(N == F::ERASE_SIZE + BLOCK_OVERHEAD);
            assert!(N <= loadtwin_common::io::isotp::MAX_MESSAGE);
        }
        let message = self.receiver.message();
        let Some((&service, body)) = message.split_first() else {
            self.request = Request::None;
            return Progress::default();
        };
        match self.request {
            Request::None => return Progress::default(),
            Request::Slow => {
                self.request = Request::Ready;
                let answer = single_frame(&[uds::NEGATIVE, service, uds::PENDING]);
                return Progress {
                    answer,
                    ..Progress::default()
                };
            }
            Request::Ready => {}
        }
        let mut burst = None;
        let mut asked = None;
        let outcome = match service {
            uds::REQUEST_DOWNLOAD => announce(&mut self.phase, message, store, longest),
            uds::TRANSFER_DATA => transfer(&mut self.phase, body, store, room),
            uds::TRANSFER_EXIT => match self.phase {
                Phase::Installing { image_len } => install(&mut self.phase, image_len, store, room)
                    .inspect_err(|_| {
                        self.failed_installations = self.failed_installations.saturating_add(1);
                    }),
                _ if self.failed_installations >= FAILED_INSTALLATIONS => {
                    Err(No::Image(ImageError::Flash))
                }
                _ => exit(&mut self.phase, body, store, room, accept),
            },
            uds::ROUTINE_CONTROL => match start_burst(message) {
                Ok(begun) => {
                    burst = Some(begun);
                    let [service, rest @ ..] = uds::BURST_ROUTINE;
                    let [kind, high, low] = rest;
                    Ok(Yes::answer(&[service + uds::POSITIVE, kind, high, low]))
                }
                Err(code) => Err(No::Request(code)),
            },
            uds::READ_DATA | uds::READ_MEMORY => match kept_counts(message) {
                Ok(request) => {
                    asked = Some(request);
                    Ok(Yes::WORKING)
                }
                Err(code) => Err(No::Request(code)),
            },
            _ => Err(No::Request(uds::SERVICE_NOT_SUPPORTED)),
        };
        if asked.is_some() || !matches!(outcome, Ok(Yes { answer: None, .. })) {
            self.request = Request::None;
        }
        match outcome {
            Ok(Yes { answer, event }) => Progress {
                answer,
                event,
                burst,
                asked,
            },
            Err(No::Request(code)) => Progress {
                answer: single_frame(&[uds::NEGATIVE, service, code]),
                ..Progress::default()
            },
            Err(No::Image(refusal)) => {
                store.abandon();
                self.phase = Phase::Idle;
                Progress {
                    answer: single_frame(&[uds::NEGATIVE, service, refusal.code()]),
                    event: Some(Event::Refused(refusal)),
                    ..Progress::default()
                }
            }
        }
    }
}

/// Without an answer the request goes on in the next poll.
struct Yes {
    answer: Option<FrameData>,
    event: Option<Event>,
}

impl Yes {
    fn answer(message: &[u8]) -> Self {
        Self {
            answer: single_frame(message),
            event: None,
        }
    }

    const WORKING: Self = Self {
        answer: None,
        event: None,
    };
}

enum No {
    /// The request makes no sense now; the upload goes on.
    Request(u8),
    /// The image is refused; the upload is over.
    Image(ImageError),
}

fn announce<F: NorFlash>(
    phase: &mut Phase,
    message: &[u8],
    store: &Store<F>,
    room: usize,
) -> Result<Yes, No> {
    let size = message
        .strip_prefix(&uds::DOWNLOAD_FORMAT)
        .ok_or(No::Request(uds::OUT_OF_RANGE))?;
    let size = <[u8; 4]>::try_from(size).map_err(|_| No::Request(uds::INCORRECT_LENGTH))?;
    let image_len = u32::from_be_bytes(size);
    match *phase {
        Phase::Idle => {}
        // Sent again because our answer was lost.
        Phase::Announced { image_len: known } if known == image_len => {}
        _ => return Err(No::Request(uds::BUSY)),
    }
    if store.restart_pending() {
        return Err(No::Image(ImageError::RestartPending));
    }
    if store.board().is_none() {
        return Err(No::Image(ImageError::NoKey));
    }
    if image_len > store.image_capacity() || image_len as usize > room {
        return Err(No::Image(ImageError::TooLong));
    }
    *phase = Phase::Announced { image_len };
    let [high, low] = ((F::ERASE_SIZE + BLOCK_OVERHEAD) as u16).to_be_bytes();
    Ok(Yes::answer(&[
        uds::REQUEST_DOWNLOAD + uds::POSITIVE,
        0x20,
        high,
        low,
    ]))
}

/// The burst of a request to start the routine that sends one; the code of its refusal.
fn start_burst(message: &[u8]) -> Result<Burst, u8> {
    let record = message
        .strip_prefix(&uds::BURST_ROUTINE)
        .ok_or(uds::OUT_OF_RANGE)?;
    if record.len() != 3 {
        return Err(uds::INCORRECT_LENGTH);
    }
    Burst::from_request(record).ok_or(uds::OUT_OF_RANGE)
}

/// What a request about kept counts asks for; the code of its refusal.
fn kept_counts(message: &[u8]) -> Result<Asked, u8> {
    if message == uds::COUNTS_LAYOUT {
        return Ok(Asked::Layout);
    }
    let record = message
        .strip_prefix(&uds::READ_FORMAT)
        .ok_or(uds::OUT_OF_RANGE)?;
    match *record {
        [a, b, c, d, size] if (1..=uds::MOST_READ).contains(&size) => Ok(Asked::Memory {
            address: u32::from_be_bytes([a, b, c, d]),
            size,
        }),
        _ => Err(uds::INCORRECT_LENGTH),
    }
}

/// Takes a block; all but the last are as long as a page.
fn transfer<F: NorFlash>(
    phase: &mut Phase,
    body: &[u8],
    store: &Store<F>,
    room: &mut [u8],
) -> Result<Yes, No> {
    let Some((&counter, piece)) = body.split_first() else {
        return Err(No::Request(uds::INCORRECT_LENGTH));
    };
    let answer = Yes::answer(&[uds::TRANSFER_DATA + uds::POSITIVE, counter]);
    let (received, image_len) = match *phase {
        Phase::Idle | Phase::Installing { .. } => return Err(No::Request(uds::SEQUENCE_ERROR)),
        Phase::Announced { image_len } => {
            if counter != 1 {
                return Err(No::Request(uds::WRONG_BLOCK_COUNTER));
            }
            store.check_header(piece, image_len).map_err(No::Image)?;
            *phase = Phase::Admitted { image_len };
            return Ok(Yes::WORKING);
        }
        Phase::Admitted { image_len } => (0, image_len),
        // Sent again because our answer was lost.
        Phase::Transfer { counter: last, .. } if counter == last => return Ok(answer),
        Phase::Transfer {
            counter: last,
            received,
            image_len,
        } => {
            if counter != last.wrapping_add(1) {
                return Err(No::Request(uds::WRONG_BLOCK_COUNTER));
            }
            (received, image_len)
        }
    };
    let wanted = image_len.saturating_sub(received).min(F::ERASE_SIZE as u32);
    let end = received.saturating_add(wanted);
    let target = room.get_mut(received as usize..end as usize);
    match target {
        Some(target) if wanted > 0 && piece.len() == target.len() => target.copy_from_slice(piece),
        _ => return Err(No::Image(ImageError::BadLength)),
    }
    *phase = Phase::Transfer {
        counter,
        received: end,
        image_len,
    };
    Ok(answer)
}

/// Checks the whole image; it is installed from the next poll on.
fn exit<F: NorFlash>(
    phase: &mut Phase,
    body: &[u8],
    store: &mut Store<F>,
    room: &[u8],
    accept: impl FnOnce(&[u8]) -> Result<(), ImageError>,
) -> Result<Yes, No> {
    if !body.is_empty() {
        return Err(No::Request(uds::INCORRECT_LENGTH));
    }
    let Phase::Transfer {
        received,
        image_len,
        ..
    } = *phase
    else {
        return Err(No::Request(uds::SEQUENCE_ERROR));
    };
    if received != image_len {
        return Err(No::Request(uds::SEQUENCE_ERROR));
    }
    let image = room.get(..image_len as usize).unwrap_or_default();
    store.begin(image, accept).map_err(No::Image)?;
    *phase = Phase::Installing { image_len };
    Ok(Yes::WORKING)
}

/// Installs one page; after the last one the image comes into force.
fn install<F: NorFlash>(
    phase: &mut Phase,
    image_len: u32,
    store: &mut Store<F>,
    room: &[u8],
) -> Result<Yes, No> {
    let image = room.get(..image_len as usize).unwrap_or_default();
    if !store.install_page(image).map_err(No::Image)? {
        return Ok(Yes::WORKING);
    }
    let active = store.finish().map_err(No::Image)?;
    *phase = Phase::Idle;
    Ok(Yes {
        event: Some(Event::Accepted(active.header.issue)),
        ..Yes::answer(&[uds::TRANSFER_EXIT + uds::POSITIVE])
    })
}
