//! Sends and receives messages of up to 4095 bytes over classic CAN frames by ISO-TP (ISO 15765-2):
//! state machines of a receiver and of a sender, with flow control and time-outs. The caller hands
//! in received frames and the time, and sends the frames that they give.
//!
//! Normal addressing; the caller filters by CAN identifier and hands in the data
//! bytes. Time is a wrapping count of microseconds. Sent frames are padded to
//! 8 bytes; received ones may be shorter where the message ends.

/// Data bytes of a frame.
pub type FrameData = [u8; 8];

/// Longest wait for the next frame of a message, or for the receiver's
/// permission (`N_Cr`, `N_Bs`) (us).
pub const TIMEOUT_US: u32 = 1_000_000;

/// Silence after which a receiver drops a message that is not complete [us]. Shorter than
/// [`TIMEOUT_US`], so that a sender that starts over after its own time-out is heard.
const SILENCE_US: u32 = TIMEOUT_US / 4 * 3;

/// Longest message (bytes).
pub const MAX_MESSAGE: usize = 4095;

/// How often in a row a sender lets itself be put off (`N_WFTmax`).
const MAX_WAITS: u8 = 16;

/// Value of unused bytes: few stuff bits, the default of ISO 15765-2.
const PADDING: u8 = 0xCC;

/// Frame type in the upper half of byte 0: a whole message (ISO 15765-2).
const SINGLE: u8 = 0x0;

/// Frame type: the first of several frames, with the length of the message.
const FIRST: u8 = 0x1;

/// Frame type: the next frame of a message, with its sequence number.
const CONSECUTIVE: u8 = 0x2;

/// Frame type: flow control by the receiver.
const FLOW_CONTROL: u8 = 0x3;

/// Flow status in the lower half of byte 0: go on.
const CONTINUE: u8 = 0;

/// Flow status: wait for another flow control.
const WAIT: u8 = 1;

/// Flow status: the message is too long for the receiver.
const OVERFLOW: u8 = 2;

/// A message of up to 7 bytes in one frame; `None` when it is empty or longer.
pub fn single_frame(message: &[u8]) -> Option<FrameData> {
    let first = (SINGLE << 4) | u8::try_from(message.len()).ok()?;
    (1..=7)
        .contains(&message.len())
        .then(|| frame(&[first], message).0)
}

/// The message in a single frame; `None` for any other frame.
pub fn single_message(data: &[u8]) -> Option<&[u8]> {
    let (&first, rest) = data.split_first()?;
    let length = usize::from(first);
    (data.len() <= 8 && (1..=7).contains(&length)).then(|| rest.get(..length))?
}

/// A frame of `head` and as much of `body` as fits; and how much that was.
fn frame(head: &[u8], body: &[u8]) -> (FrameData, usize) {
    let mut data = [PADDING; 8];
    for (d, s) in data.iter_mut().zip(head.iter().chain(body)) {
        *d = *s;
    }
    (data, body.len().min(8usize.saturating_sub(head.len())))
}

/// What a received frame led to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Received {
    /// Nothing to do.
    Nothing,
    /// Send this flow control frame.
    Reply(FrameData),
    /// A message is complete, see [`Receiver::message`].
    Message,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Segmented {
    total: usize,
    /// Sequence number of the next frame, 0..=15.
    next: u8,
    /// Frames until the next flow control; 0: no more is due.
    until_reply: u8,
    last_us: u32,
}

/// Receiver of messages of up to `N` bytes.
#[derive(Clone, Debug)]
pub struct Receiver<const N: usize> {
    buffer: heapless::Vec<u8, N>,
    segmented: Option<Segmented>,
    block_size: u8,
    separation: u8,
}

impl<const N: usize> Receiver<N> {
    /// `block_size`: frames that may follow one permission, 0: all;
    /// `separation`: `STmin` as coded in a flow control frame (0..=127: ms,
    /// 0xF1..=0xF9: 100 to 900 us).
    pub fn new(block_size: u8, separation: u8) -> Self {
        Self {
            buffer: heapless::Vec::new(),
            segmented: None,
            block_size,
            separation,
        }
    }

    /// The last complete message; empty while one is being received.
    pub fn message(&self) -> &[u8] {
        if self.segmented.is_some() {
            &[]
        } else {
            &self.buffer
        }
    }

    /// Takes a frame's data bytes.
    ///
    /// While a message is being received, frames that are not its next one are ignored. ISO
    /// 15765-2, 9.8.3, drops the message then, so that one stray frame would end an upload. A
    /// message without its next frame for three quarters of [`TIMEOUT_US`] is dropped.
    pub fn on_frame(&mut self, data: &[u8], now_us: u32) -> Received {
        let Some(&first) = data.first() else {
            return Received::Nothing;
        };
        if data.len() > 8 {
            return Received::Nothing;
        }
        if (self.segmented).is_some_and(|s| now_us.wrapping_sub(s.last_us) >= SILENCE_US) {
            self.segmented = None;
            self.buffer.clear();
        }
        match first >> 4 {
            SINGLE | FIRST if self.segmented.is_some() => Received::Nothing,
            SINGLE => self.on_single(data),
            FIRST => self.on_first(data, now_us),
            CONSECUTIVE => {
                self.on_consecutive(first & 0xF, data.get(1..).unwrap_or_default(), now_us)
            }
            _ => Received::Nothing,
        }
    }

    fn on_single(&mut self, data: &[u8]) -> Received {
        let Some(message) = single_message(data) else {
            return Received::Nothing;
        };
        self.buffer.clear();
        match self.buffer.extend_from_slice(message) {
            Ok(()) => Received::Message,
            Err(_) => Received::Nothing,
        }
    }

    fn on_first(&mut self, data: &[u8], now_us: u32) -> Received {
        let &[high, low, ref body @ ..] = data else {
            return Received::Nothing;
        };
        let total = usize::from(u16::from_be_bytes([high & 0xF, low]));
        // 0 announces the 32 bit length of a message longer than any taken here.
        if body.len() != 6 || (total != 0 && total <= 7) {
            return Received::Nothing;
        }
        self.buffer.clear();
        if total == 0 || total > N || self.buffer.extend_from_slice(body).is_err() {
            return Received::Reply(self.flow_control(OVERFLOW));
        }
        self.segmented = Some(Segmented {
            total,
            next: 1,
            until_reply: self.block_size,
            last_us: now_us,
        });
        Received::Reply(self.flow_control(CONTINUE))
    }

    fn on_consecutive(&mut self, sequence: u8, body: &[u8], now_us: u32) -> Received {
        let Some(mut s) = self.segmented else {
            return Received::Nothing;
        };
        let wanted = s.total.saturating_sub(self.buffer.len()).min(7);
        let piece = body.get(..wanted).filter(|_| sequence == s.next);
        if piece.is_none_or(|p| self.buffer.extend_from_slice(p).is_err()) {
            return Received::Nothing;
        }
        if self.buffer.len() >= s.total {
            self.segmented = None;
            return Received::Message;
        }
        s.next = (s.next + 1) & 0xF;
        s.last_us = now_us;
        let reply_due = s.until_reply == 1;
        s.until_reply = if reply_due {
            self.block_size
        } else {
            s.until_reply.saturating_sub(1)
        };
        self.segmented = Some(s);
        if reply_due {
            Received::Reply(self.flow_control(CONTINUE))
        } else {
            Received::Nothing
        }
    }

    fn flow_control(&self, status: u8) -> FrameData {
        frame(
            &[
                (FLOW_CONTROL << 4) | status,
                self.block_size,
                self.separation,
            ],
            &[],
        )
        .0
    }
}

/// Why a message could not be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SendError {
    /// The receiver gave no permission within [`TIMEOUT_US`].
    Timeout,
    /// The receiver has no room for the message.
    Overflow,
    /// The receiver put the sender off too often, or answered nonsense.
    FlowControl,
}

/// What a sender wants next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sending {
    /// Send this frame, then ask again.
    Frame(FrameData),
    /// Ask again after so many microseconds, or after the receiver's next frame.
    Wait(u32),
    /// All of the message is sent.
    Done,
    /// Given up.
    Failed(SendError),
}

#[derive(Clone, Copy, Debug)]
enum Phase {
    Start,
    Permission {
        since_us: u32,
        waits: u8,
    },
    /// `left`: frames that may follow, `None`: all.
    Flow {
        left: Option<u8>,
        separation_us: u32,
        last_us: u32,
        sent: bool,
    },
    Failed(SendError),
}

/// Sender of one message.
#[derive(Clone, Debug)]
pub struct Sender<M> {
    message: M,
    offset: usize,
    next: u8,
    phase: Phase,
}

impl<M: AsRef<[u8]>> Sender<M> {
    /// `None` when the message is empty or longer than [`MAX_MESSAGE`].
    pub fn new(message: M) -> Option<Self> {
        (1..=MAX_MESSAGE)
            .contains(&message.as_ref().len())
            .then_some(Self {
                message,
                offset: 0,
                next: 1,
                phase: Phase::Start,
            })
    }

    /// The next thing to do at this time.
    pub fn poll(&mut self, now_us: u32) -> Sending {
        let message = self.message.as_ref();
        let rest = message.get(self.offset..).unwrap_or_default();
        match self.phase {
            Phase::Failed(error) => Sending::Failed(error),
            _ if rest.is_empty() => Sending::Done,
            Phase::Start => {
                let (data, taken) = if let Some(data) = single_frame(message) {
                    (data, message.len())
                } else {
                    let length = message.len() as u16 | (u16::from(FIRST) << 12);
                    frame(&length.to_be_bytes(), message)
                };
                self.offset = taken;
                self.phase = Phase::Permission {
                    since_us: now_us,
                    waits: 0,
                };
                Sending::Frame(data)
            }
            Phase::Permission { since_us, .. } => {
                match TIMEOUT_US.checked_sub(now_us.wrapping_sub(since_us)) {
                    None | Some(0) => self.fail(SendError::Timeout),
                    Some(left) => Sending::Wait(left),
                }
            }
            Phase::Flow {
                left,
                separation_us,
                last_us,
                sent,
            } => {
                let due = separation_us.saturating_sub(now_us.wrapping_sub(last_us));
                if sent && due > 0 {
                    return Sending::Wait(due);
                }
                let (data, taken) = frame(&[(CONSECUTIVE << 4) | self.next], rest);
                self.offset += taken;
                self.next = (self.next + 1) & 0xF;
                let left = left.map(|n| n.saturating_sub(1));
                self.phase = if left == Some(0) {
                    Phase::Permission {
                        since_us: now_us,
                        waits: 0,
                    }
                } else {
                    Phase::Flow {
                        left,
                        separation_us,
                        last_us: now_us,
                        sent: true,
                    }
                };
                Sending::Frame(data)
            }
        }
    }

    /// Takes a frame from the receiver; all but flow control is ignored.
    pub fn on_frame(&mut self, data: &[u8], now_us: u32) {
        let Phase::Permission { waits, .. } = self.phase else {
            return;
        };
        let &[first, block_size, separation, ..] = data else {
            return;
        };
        if first >> 4 != FLOW_CONTROL || self.offset == 0 || data.len() > 8 {
            return;
        }
        self.phase = match first & 0xF {
            CONTINUE => Phase::Flow {
                left: (block_size != 0).then_some(block_size),
                separation_us: separation_us(separation),
                last_us: now_us,
                sent: false,
            },
            WAIT if waits < MAX_WAITS => Phase::Permission {
                since_us: now_us,
                waits: waits + 1,
            },
            OVERFLOW => Phase::Failed(SendError::Overflow),
            _ => Phase::Failed(SendError::FlowControl),
        };
    }

    fn fail(&mut self, error: SendError) -> Sending {
        self.phase = Phase::Failed(error);
        Sending::Failed(error)
    }
}

/// `STmin` [us]; reserved codes mean the longest, 127 ms (ISO 15765-2, 9.6.5.5).
fn separation_us(code: u8) -> u32 {
    match code {
        0..=0x7F => u32::from(code) * 1000,
        0xF1..=0xF9 => u32::from(code - 0xF0) * 100,
        _ => 127_000,
    }
}
