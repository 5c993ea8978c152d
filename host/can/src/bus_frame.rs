//! Represents one CAN frame of any interface or log (`BusFrame`: classic, FD, remote or error
//! frame). Checks identifier and length when a frame is made, converts length codes to bytes, and
//! prints the text of `candump -L`.

use std::fmt;

/// Lengths that a frame may have (bytes); above 8 those of FD frames alone.
const LENGTHS: [u8; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];

/// Longest payload of a classic frame (bytes).
const CLASSIC: usize = 8;

/// Longest payload of an FD frame (bytes).
const LONGEST: usize = 64;

/// Bit by which Linux marks the identifier of an error frame.
pub const ERROR_FLAG: u32 = 0x2000_0000;

/// Bit of an error frame's identifier: the controller is bus-off.
pub const BUS_OFF: u32 = 0x40;

/// Bit of an error frame's identifier: the controller has come back.
pub const RESTARTED: u32 = 0x100;

/// What a frame is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameKind {
    /// A classic data frame.
    Data,
    /// An FD frame; bit 0: sent at two rates, bit 1: its sender is error passive.
    Fd {
        /// The flags.
        flags: u8,
    },
    /// A request for data.
    Remote,
    /// What the controller reports; the identifier has the causes.
    Error,
}

/// A frame.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct BusFrame {
    kind: FrameKind,
    id: u32,
    is_extended: bool,
    length: u8,
    bytes: [u8; LONGEST],
}

impl BusFrame {
    /// A frame; none where the identifier or the length of `data` is that of no such frame.
    pub fn new(kind: FrameKind, id: u32, is_extended: bool, data: &[u8]) -> Option<Self> {
        let most_id = if is_extended || kind == FrameKind::Error {
            0x1FFF_FFFF
        } else {
            0x7FF
        };
        let most = if matches!(kind, FrameKind::Fd { .. }) {
            LONGEST
        } else {
            CLASSIC
        };
        let length = u8::try_from(data.len()).ok()?;
        if id > most_id || data.len() > most || !LENGTHS.contains(&length) {
            return None;
        }
        let mut bytes = [0; LONGEST];
        bytes[..data.len()].copy_from_slice(data);
        Some(Self {
            kind,
            id,
            is_extended,
            length,
            bytes,
        })
    }

    /// A request for `length` bytes.
    pub fn remote(id: u32, is_extended: bool, length: u8) -> Option<Self> {
        let none = Self::new(FrameKind::Remote, id, is_extended, &[])?;
        (usize::from(length) <= CLASSIC).then_some(Self { length, ..none })
    }

    /// What it is.
    pub fn kind(&self) -> FrameKind {
        self.kind
    }

    /// Whether it reports an error of the controller.
    pub fn is_error(&self) -> bool {
        self.kind == FrameKind::Error
    }

    /// The identifier; of an error frame the causes.
    pub fn id(&self) -> u32 {
        self.id
    }

    /// Whether the identifier has 29 bits.
    pub fn is_extended(&self) -> bool {
        self.is_extended
    }

    /// The payload; of a remote frame nothing.
    pub fn data(&self) -> &[u8] {
        match self.kind {
            FrameKind::Remote => &[],
            _ => self
                .bytes
                .get(..usize::from(self.length))
                .unwrap_or_default(),
        }
    }

    /// The length that it states (bytes).
    pub fn length(&self) -> u8 {
        self.length
    }

    /// The length that a data length code stands for (bytes).
    pub fn length_of_code(code: u8) -> Option<u8> {
        LENGTHS.get(usize::from(code)).copied()
    }
}

/// As `candump -L` writes it.
impl fmt::Display for BusFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.kind, self.is_extended) {
            (FrameKind::Error, _) => write!(f, "{:08X}#", self.id | ERROR_FLAG)?,
            (_, true) => write!(f, "{:08X}#", self.id)?,
            (_, false) => write!(f, "{:03X}#", self.id)?,
        }
        match self.kind {
            FrameKind::Remote if self.length > 0 => write!(f, "R{}", self.length)?,
            FrameKind::Remote => f.write_str("R")?,
            FrameKind::Fd { flags } => write!(f, "#{:X}", flags & 0xF)?,
            FrameKind::Data | FrameKind::Error => {}
        }
        self.data()
            .iter()
            .try_for_each(|byte| write!(f, "{byte:02X}"))
    }
}

impl fmt::Debug for BusFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_frames_that_a_bus_carries() {
        let fd = FrameKind::Fd { flags: 0 };
        assert!(BusFrame::new(FrameKind::Data, 0x7FF, false, &[0; 8]).is_some());
        assert!(BusFrame::new(FrameKind::Data, 0x800, false, &[]).is_none());
        assert!(BusFrame::new(FrameKind::Data, 0x800, true, &[]).is_some());
        assert!(BusFrame::new(FrameKind::Data, 1, false, &[0; 9]).is_none());
        assert!(BusFrame::new(fd, 1, false, &[0; 9]).is_none());
        assert!(BusFrame::new(fd, 1, false, &[0; 64]).is_some());
        assert!(BusFrame::remote(1, false, 9).is_none());
    }

    #[test]
    fn text_is_that_of_candump() {
        let shown = |frame: Option<BusFrame>| frame.expect("a frame").to_string();
        assert_eq!(
            shown(BusFrame::new(FrameKind::Data, 0x12, false, &[1, 0xAB])),
            "012#01AB"
        );
        let fd = FrameKind::Fd { flags: 1 };
        assert_eq!(shown(BusFrame::new(fd, 0x12, true, &[2])), "00000012##102");
        assert_eq!(shown(BusFrame::remote(0x123, false, 8)), "123#R8");
        assert_eq!(
            shown(BusFrame::new(FrameKind::Error, 4, false, &[0; 8])),
            "20000004#0000000000000000"
        );
    }
}
