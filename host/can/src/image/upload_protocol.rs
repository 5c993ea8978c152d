//! State machine that uploads a sealed image to a board by the UDS download services over ISO-TP.
//! Repeats requests that are not answered, and the whole image where it arrived damaged. Returns
//! the data of the next frame to send, a wait, or the result (accepted, refused, no verdict);
//! `upload.rs` moves the frames over a bus.
//!
//! No socket and no clock: frames with [`uds::ANSWER_ID`] go into
//! [`Uploader::on_frame`], frames from [`Uploader::poll`] go out with
//! [`uds::REQUEST_ID`].

use loadtwin_common::io::isotp::{
    FrameData, MAX_MESSAGE, SendError, Sender, Sending, single_message,
};
use loadtwin_common::io::signed_image;
use loadtwin_common::io::signed_image::{HEADER_LEN, ImageError};
use loadtwin_common::io::uds;
use thiserror::Error;

/// Longest wait for an answer (us).
const ANSWER_US: u32 = 1_000_000;
/// Longest wait after "still at work" (us; ISO 14229-2, P2* with room for a
/// signature check and a slot read at the slowest clock).
const WORK_US: u32 = 10_000_000;
/// How often a request is sent before the upload is given up.
const ATTEMPTS: u8 = 8;
/// How often the whole image is sent: a stray frame between those of a block damages it on its way.
const PASSES: u8 = 3;

/// Why an upload failed; the running model stays unless `NoVerdict`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum UploadError {
    /// The board, or this host before it sent anything, refused the image.
    #[error("refused: {0}")]
    Refused(ImageError),
    /// The board answered a request with a code that is no reason of an image.
    #[error("request {service:#04x} answered with code {code:#04x}")]
    Answered {
        /// The request's service.
        service: u8,
        /// ISO 14229-1 negative response code.
        code: u8,
    },
    /// The board takes blocks of a length that cannot be.
    #[error("found blocks of {0} bytes, allowed: 118 to 4095")]
    BlockLength(usize),
    /// The board does not answer.
    #[error("no answer to request {0:#04x}")]
    NoAnswer(u8),
    /// The board did not answer the last request: its status frame reports what runs.
    #[error("no verdict: the image may have been accepted or not")]
    NoVerdict,
    /// The request could not be handed over.
    #[error("request {service:#04x} not taken: {reason:?}")]
    NotTaken {
        /// The request's service.
        service: u8,
        /// What the transport met.
        reason: SendError,
    },
}

/// What an upload wants next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// Send this frame, then ask again.
    Frame(FrameData),
    /// Ask again after so many microseconds, or after the next answer frame.
    Wait(u32),
    /// The board has accepted the image; it runs after a restart.
    Accepted,
    /// Given up.
    Failed(UploadError),
}

#[derive(Debug)]
enum Phase {
    Sending(Sender<Vec<u8>>),
    Answer { since_us: u32, limit_us: u32 },
    Over(Next),
}

/// Sending end of an upload.
#[derive(Debug)]
pub struct Uploader {
    image: Vec<u8>,
    /// Bytes of the image in a block; 0 until the board has reported it.
    block: usize,
    sent: usize,
    counter: u8,
    request: Vec<u8>,
    attempts: u8,
    passes: u8,
    phase: Phase,
}

impl Uploader {
    /// Starts an upload of a whole sealed image.
    ///
    /// # Errors
    /// `UploadError::Refused` when the image is damaged or not signed: the board
    /// would say the same.
    pub fn new(image: Vec<u8>) -> Result<Self, UploadError> {
        let (header, _) = signed_image::open(&image).map_err(UploadError::Refused)?;
        if header.signature == [0; 64] {
            return Err(UploadError::Refused(ImageError::Unsigned));
        }
        let mut uploader = Self {
            image,
            block: 0,
            sent: 0,
            counter: 0,
            request: Vec::new(),
            attempts: 0,
            passes: 0,
            phase: Phase::Over(Next::Accepted),
        };
        uploader.announce();
        Ok(uploader)
    }

    fn announce(&mut self) {
        self.sent = 0;
        self.counter = 0;
        self.passes += 1;
        let length = self.image.len() as u32;
        self.start([&uds::DOWNLOAD_FORMAT[..], &length.to_be_bytes()].concat());
    }

    /// Bytes that the board has taken, and of how many.
    pub fn progress(&self) -> (usize, usize) {
        (self.sent, self.image.len())
    }

    /// The next thing to do at the time `now_us` (us, wrapping).
    pub fn poll(&mut self, now_us: u32) -> Next {
        match &mut self.phase {
            Phase::Over(next) => *next,
            Phase::Sending(sender) => match sender.poll(now_us) {
                Sending::Frame(data) => Next::Frame(data),
                Sending::Wait(us) => Next::Wait(us),
                Sending::Done => {
                    self.phase = Phase::Answer {
                        since_us: now_us,
                        limit_us: ANSWER_US,
                    };
                    Next::Wait(ANSWER_US)
                }
                Sending::Failed(reason) => {
                    let service = self.service();
                    self.again(now_us, UploadError::NotTaken { service, reason })
                }
            },
            Phase::Answer { since_us, limit_us } => {
                match limit_us.checked_sub(now_us.wrapping_sub(*since_us)) {
                    Some(left) if left > 0 => Next::Wait(left),
                    _ => match self.service() {
                        uds::TRANSFER_EXIT => self.again(now_us, UploadError::NoVerdict),
                        service => self.again(now_us, UploadError::NoAnswer(service)),
                    },
                }
            }
        }
    }

    /// Takes the data of a frame from the board.
    pub fn on_frame(&mut self, data: &[u8], now_us: u32) {
        let Some(message) = single_message(data) else {
            if let Phase::Sending(sender) = &mut self.phase {
                sender.on_frame(data, now_us);
            }
            return;
        };
        if matches!(self.phase, Phase::Over(_)) {
            return;
        }
        let service = self.service();
        match *message {
            [uds::NEGATIVE, s, uds::PENDING] if s == service => {
                self.phase = Phase::Answer {
                    since_us: now_us,
                    limit_us: WORK_US,
                };
            }
            // Another upload is under way: the request is sent again after a while.
            [uds::NEGATIVE, s, uds::BUSY] if s == service => {
                self.phase = Phase::Answer {
                    since_us: now_us,
                    limit_us: ANSWER_US,
                };
            }
            // Asked again after its verdict, which was lost, a board knows of no upload.
            [uds::NEGATIVE, s, uds::SEQUENCE_ERROR]
                if s == service && s == uds::TRANSFER_EXIT && self.attempts > 1 =>
            {
                self.over(Next::Failed(UploadError::NoVerdict));
            }
            [uds::NEGATIVE, s, code]
                if s == service
                    && self.passes < PASSES
                    && matches!(
                        ImageError::from_code(code),
                        Some(ImageError::BadCrc | ImageError::BadDigest)
                    ) =>
            {
                self.announce();
            }
            [uds::NEGATIVE, s, code] if s == service => {
                let error = ImageError::from_code(code).map_or(
                    UploadError::Answered { service, code },
                    UploadError::Refused,
                );
                self.over(Next::Failed(error));
            }
            [s, 0x20, high, low]
                if s == uds::REQUEST_DOWNLOAD + uds::POSITIVE
                    && service == uds::REQUEST_DOWNLOAD =>
            {
                let length = usize::from(u16::from_be_bytes([high, low]));
                if (HEADER_LEN + 2..=MAX_MESSAGE).contains(&length) {
                    self.block = length - 2;
                    self.next_block();
                } else {
                    self.over(Next::Failed(UploadError::BlockLength(length)));
                }
            }
            [s, counter]
                if s == uds::TRANSFER_DATA + uds::POSITIVE
                    && service == uds::TRANSFER_DATA
                    && counter == self.counter =>
            {
                self.sent += self.request.len() - 2;
                if self.sent == self.image.len() {
                    self.start(vec![uds::TRANSFER_EXIT]);
                } else {
                    self.next_block();
                }
            }
            [s] if s == uds::TRANSFER_EXIT + uds::POSITIVE && service == uds::TRANSFER_EXIT => {
                self.over(Next::Accepted);
            }
            _ => {}
        }
    }

    fn service(&self) -> u8 {
        self.request.first().copied().unwrap_or_default()
    }

    fn next_block(&mut self) {
        self.counter = self.counter.wrapping_add(1);
        let end = self.image.len().min(self.sent + self.block);
        let request = [
            &[uds::TRANSFER_DATA, self.counter],
            &self.image[self.sent..end],
        ]
        .concat();
        self.start(request);
    }

    fn start(&mut self, request: Vec<u8>) {
        self.attempts = 0;
        self.request = request;
        self.send();
    }

    fn send(&mut self) {
        self.attempts += 1;
        self.phase = match Sender::new(self.request.clone()) {
            Some(sender) => Phase::Sending(sender),
            None => Phase::Over(Next::Failed(UploadError::BlockLength(self.request.len()))),
        };
    }

    /// Sends the request again, or gives up.
    fn again(&mut self, now_us: u32, error: UploadError) -> Next {
        if self.attempts < ATTEMPTS {
            self.send();
            self.poll(now_us)
        } else {
            self.over(Next::Failed(error))
        }
    }

    fn over(&mut self, next: Next) -> Next {
        self.phase = Phase::Over(next);
        next
    }
}
