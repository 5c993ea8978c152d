//! Taking a model image from the bus: UDS download services over ISO-TP.
//!
//! [`Upload::on_frame`] belongs where frames are received: it answers with flow
//! control and never blocks. [`Upload::poll`] belongs in the background, below
//! the estimator: it erases, writes and checks the signature.
//!
//! Nothing here decides who may upload: the [`Store`] takes what the board's
//! key has signed and what is newer than the running image, and nothing else.

use embedded_storage::nor_flash::NorFlash;
use loadtwin_common::isotp::{FrameData, Received, Receiver, single_frame};
use loadtwin_common::sealed::Refusal;
use loadtwin_common::uds;

use crate::store::Store;

/// What a transfer request adds to a block: service and counter [bytes].
pub const BLOCK_OVERHEAD: usize = 2;

/// Frames that may follow one flow control. Low enough for a receive queue of
/// 16 frames.
const BLOCK_SIZE: u8 = 16;

/// What became of an upload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// The image of this issue is in force; it starts at the next restart.
    Accepted(u32),
    /// Refused; the running model stays.
    Refused(Refusal),
}

/// What a [`Upload::poll`] led to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Progress {
    /// Frame to send with [`uds::ANSWER_ID`].
    pub answer: Option<FrameData>,
    /// The verdict on an image, for the status frame.
    pub event: Option<Event>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Idle,
    /// Announced; the first block brings the header.
    Announced {
        image_len: u32,
    },
    /// `counter`: of the last block written.
    Transfer {
        counter: u8,
        missing: u32,
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
        }
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
            Received::Reply(frame) => Some(frame),
            Received::Message => {
                // The header's signature and the whole image take longer than
                // the 50 ms within which an answer is due.
                let slow = match self.receiver.message() {
                    [uds::TRANSFER_DATA, ..] => matches!(self.phase, Phase::Announced { .. }),
                    [uds::TRANSFER_EXIT] => true,
                    _ => false,
                };
                self.request = if slow { Request::Slow } else { Request::Ready };
                None
            }
        }
    }

    /// Works on the request received, if any.
    ///
    /// `accept`: as for [`Store::boot`].
    pub fn poll<F: NorFlash>(
        &mut self,
        store: &mut Store<F>,
        accept: impl FnMut(&mut F, u32, u32) -> bool,
    ) -> Progress {
        const {
            assert!(N == F::ERASE_SIZE + BLOCK_OVERHEAD);
            assert!(N <= loadtwin_common::isotp::MAX_MESSAGE);
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
                    event: None,
                };
            }
            Request::Ready => self.request = Request::None,
        }
        let outcome = match service {
            uds::REQUEST_DOWNLOAD => announce(&mut self.phase, message, store),
            uds::TRANSFER_DATA => transfer(&mut self.phase, body, store),
            uds::TRANSFER_EXIT => exit(&mut self.phase, body, store, accept),
            _ => Err(No::Request(uds::SERVICE_NOT_SUPPORTED)),
        };
        match outcome {
            Ok(Yes { answer, event }) => Progress { answer, event },
            Err(No::Request(code)) => Progress {
                answer: single_frame(&[uds::NEGATIVE, service, code]),
                event: None,
            },
            Err(No::Image(refusal)) => {
                store.abandon();
                self.phase = Phase::Idle;
                Progress {
                    answer: single_frame(&[uds::NEGATIVE, service, refusal.code()]),
                    event: Some(Event::Refused(refusal)),
                }
            }
        }
    }
}

struct Yes {
    answer: Option<FrameData>,
    event: Option<Event>,
}

enum No {
    /// The request makes no sense now; the upload goes on.
    Request(u8),
    /// The image is refused; the upload is over.
    Image(Refusal),
}

fn announce<F: NorFlash>(
    phase: &mut Phase,
    message: &[u8],
    store: &mut Store<F>,
) -> Result<Yes, No> {
    let size = message
        .strip_prefix(&uds::DOWNLOAD_FORMAT)
        .ok_or(No::Request(uds::OUT_OF_RANGE))?;
    let size = <[u8; 4]>::try_from(size).map_err(|_| No::Request(uds::INCORRECT_LENGTH))?;
    let image_len = u32::from_be_bytes(size);
    store.abandon();
    *phase = Phase::Idle;
    if store.restart_pending() {
        return Err(No::Image(Refusal::RestartPending));
    }
    if store.key().is_none() {
        return Err(No::Image(Refusal::NoKey));
    }
    if image_len > store.image_capacity() {
        return Err(No::Image(Refusal::TooLong));
    }
    *phase = Phase::Announced { image_len };
    let [high, low] = ((F::ERASE_SIZE + BLOCK_OVERHEAD) as u16).to_be_bytes();
    let answer = single_frame(&[uds::REQUEST_DOWNLOAD + uds::POSITIVE, 0x20, high, low]);
    Ok(Yes {
        answer,
        event: None,
    })
}

fn transfer<F: NorFlash>(phase: &mut Phase, body: &[u8], store: &mut Store<F>) -> Result<Yes, No> {
    let Some((&counter, piece)) = body.split_first() else {
        return Err(No::Request(uds::INCORRECT_LENGTH));
    };
    let answer = single_frame(&[uds::TRANSFER_DATA + uds::POSITIVE, counter]);
    let missing = match *phase {
        Phase::Idle => return Err(No::Request(uds::SEQUENCE_ERROR)),
        Phase::Announced { image_len } => {
            if counter != 1 {
                return Err(No::Request(uds::WRONG_BLOCK_COUNTER));
            }
            store.begin(piece, image_len).map_err(No::Image)?;
            image_len
        }
        // Sent again because our answer was lost: written already.
        Phase::Transfer { counter: last, .. } if counter == last => {
            return Ok(Yes {
                answer,
                event: None,
            });
        }
        Phase::Transfer {
            counter: last,
            missing,
        } => {
            if counter != last.wrapping_add(1) {
                return Err(No::Request(uds::WRONG_BLOCK_COUNTER));
            }
            missing
        }
    };
    store.write(piece).map_err(No::Image)?;
    let missing = missing.saturating_sub(piece.len() as u32);
    *phase = Phase::Transfer { counter, missing };
    Ok(Yes {
        answer,
        event: None,
    })
}

fn exit<F: NorFlash>(
    phase: &mut Phase,
    body: &[u8],
    store: &mut Store<F>,
    accept: impl FnMut(&mut F, u32, u32) -> bool,
) -> Result<Yes, No> {
    if !body.is_empty() {
        return Err(No::Request(uds::INCORRECT_LENGTH));
    }
    let Phase::Transfer { missing: 0, .. } = *phase else {
        return Err(No::Request(uds::SEQUENCE_ERROR));
    };
    let active = store.finish(accept).map_err(No::Image)?;
    *phase = Phase::Idle;
    let answer = single_frame(&[uds::TRANSFER_EXIT + uds::POSITIVE]);
    Ok(Yes {
        answer,
        event: Some(Event::Accepted(active.header.issue)),
    })
}
