//! Reads frames with time and channel from BLF files, the binary log of CAN buses by Vector's
//! tools. Damaged or missing containers are counted and passed over.
//!
//! A file header `LOGG`, then objects `LOBJ`. Those of a log stand in containers, most of them
//! compressed by zlib; an object may begin in one and end in the next.

use std::io::{self, Read};

use flate2::read::ZlibDecoder;

use super::line_parsing::Line;
use crate::bus_frame::{BusFrame, FrameKind};

/// Type of an object: a container of others, as Vector numbers them (`BL_OBJ_TYPE_LOG_CONTAINER`).
const CONTAINER: u32 = 10;

/// Type of an object: a classic frame.
const CAN_MESSAGE: u32 = 1;

/// Type of an object: a classic frame with its length in time.
const CAN_MESSAGE_2: u32 = 86;

/// Type of an object: an error frame.
const CAN_ERROR: u32 = 2;

/// Type of an object: an error frame with its cause.
const CAN_ERROR_EXT: u32 = 73;

/// Type of an object: an FD frame.
const CAN_FD_MESSAGE: u32 = 100;

/// Type of an object: an FD frame in its later layout, of variable length.
const CAN_FD_MESSAGE_64: u32 = 101;

/// Largest container and largest object (bytes): the usual writers make 128 KiB.
const LARGEST: usize = 64 << 20;

/// Head of the file up to its stated size: signature, length of the head, program, size.
const FILE_HEAD: usize = 24;

/// Where the stated size stands in it.
const FILE_SIZE: std::ops::Range<usize> = 16..24;

/// Head of each object: signature, sizes, type.
const HEAD: usize = 16;

/// Bit of an identifier: it has 29 bits.
const EXTENDED: u32 = 0x8000_0000;

/// Reads frames.
pub(super) struct Blf<R> {
    source: R,
    /// Objects that are not read yet.
    objects: Vec<u8>,
    at: usize,
    started: bool,
    /// Containers read, those that are damaged or missing, and the first of them.
    containers: u64,
    malformed: u64,
    first_malformed: Option<u64>,
    /// Bytes read, and those that the header states; 0 where its writer did not come to an end.
    read: u64,
    stated: u64,
    ended: bool,
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes(bytes.get(at..at + 2)?.try_into().ok()?))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?))
}

fn damaged(what: &str) -> io::Error {
    io::Error::new(
        io::ErrorKind::InvalidData,
        format!("the BLF log is damaged: {what}"),
    )
}

impl<R: Read> Blf<R> {
    pub(super) fn new(source: R) -> Self {
        Self {
            source,
            objects: Vec::new(),
            at: 0,
            started: false,
            containers: 0,
            malformed: 0,
            first_malformed: None,
            read: 0,
            stated: 0,
            ended: false,
        }
    }

    /// Containers that are damaged or missing, and the number of the first.
    pub(super) fn malformed(&self) -> (u64, Option<u64>) {
        (self.malformed, self.first_malformed)
    }

    fn count_malformed(&mut self) {
        self.malformed += 1;
        self.first_malformed.get_or_insert(self.containers);
    }

    /// The next frame; none at the end.
    pub(super) fn next(&mut self) -> io::Result<Option<Line>> {
        loop {
            let Some(object) = self.object()? else {
                return Ok(None);
            };
            if let Some(line) = message(&object) {
                return Ok(Some(line));
            }
        }
    }

    /// The next object inside of containers.
    fn object(&mut self) -> io::Result<Option<Vec<u8>>> {
        loop {
            let open = self.objects.get(self.at..).unwrap_or_default();
            // Padding to whole words stands between objects.
            let start = memchr::memmem::find(open, b"LOBJ");
            let size = start.and_then(|start| Some((start, u32_at(open, start + 8)? as usize)));
            if let Some((start, size)) = size {
                if !(HEAD..=LARGEST).contains(&size) {
                    // On to what looks like the next object.
                    self.at += start + 4;
                    self.count_malformed();
                    continue;
                }
                if let Some(object) = open.get(start..start + size) {
                    let object = object.to_vec();
                    self.at += start + size;
                    return Ok(Some(object));
                }
            }
            if !self.fill()? {
                return Ok(None);
            }
        }
    }

    /// Reads the next container; false at the end. A damaged one is counted and passed over.
    fn fill(&mut self) -> io::Result<bool> {
        if !self.started {
            self.started = true;
            let head = self.take(FILE_HEAD)?;
            let size = u32_at(&head, 4).unwrap_or(0) as usize;
            if !head.starts_with(b"LOGG") || !(FILE_HEAD..=LARGEST).contains(&size) {
                return Err(damaged("its header"));
            }
            if self.take(size - FILE_HEAD)?.len() < size - FILE_HEAD {
                return Err(damaged("its header is cut off"));
            }
            let stated = head.get(FILE_SIZE).and_then(|bytes| bytes.try_into().ok());
            self.stated = stated.map_or(0, u64::from_le_bytes);
        }
        if self.ended {
            return Ok(false);
        }
        let head = self.take(HEAD)?;
        self.ended = head.len() < HEAD;
        if self.ended {
            if self.read < self.stated {
                // What the header states and is not there is missing.
                self.containers += 1;
                self.count_malformed();
            }
            return Ok(false);
        }
        self.containers += 1;
        let (size, kind) = (
            u32_at(&head, 8).unwrap_or(0) as usize,
            u32_at(&head, 12).unwrap_or(0),
        );
        if !head.starts_with(b"LOBJ") || !(HEAD..=LARGEST).contains(&size) {
            // Where the next one begins is not known.
            self.count_malformed();
            self.ended = true;
            return Ok(false);
        }
        let body = self.take(size - HEAD)?;
        // Objects are padded to whole words in the file.
        self.take(size % 4)?;
        self.objects.drain(..self.at.min(self.objects.len()));
        self.at = 0;
        if kind != CONTAINER {
            self.objects.extend(head);
            self.objects.extend(body);
            return Ok(true);
        }
        match (u16_at(&body, 0), body.get(16..)) {
            (Some(0), Some(content)) => self.objects.extend(content),
            (Some(2), Some(content)) => {
                let mut expanded = ZlibDecoder::new(content).take(LARGEST as u64);
                // The damage shows later than it stands, and what begins before it has no end. What a cut at the end
                // of the file leaves is whole; it is counted there.
                if let Err(error) = expanded.read_to_end(&mut self.objects)
                    && (error.kind() != io::ErrorKind::UnexpectedEof || self.read >= self.stated)
                {
                    self.objects.clear();
                    self.count_malformed();
                }
            }
            _ => self.count_malformed(),
        }
        Ok(true)
    }

    fn take(&mut self, size: usize) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.source
            .by_ref()
            .take(size as u64)
            .read_to_end(&mut bytes)?;
        self.read += bytes.len() as u64;
        Ok(bytes)
    }
}

/// The frame of an object; none where it is of another kind.
fn message(object: &[u8]) -> Option<Line> {
    let (header, kind) = (usize::from(u16_at(object, 4)?), u32_at(object, 12)?);
    let unit_ns = if u32_at(object, HEAD)? & 1 != 0 {
        10_000
    } else {
        1
    };
    let ticks = u64::from_le_bytes(object.get(24..32)?.try_into().ok()?);
    let body = object.get(header..)?;
    let (channel, frame) = match kind {
        CAN_MESSAGE | CAN_MESSAGE_2 => classic(body)?,
        CAN_ERROR | CAN_ERROR_EXT => (
            u16_at(body, 0)?,
            BusFrame::new(FrameKind::Error, 0, false, &[0; 8])?,
        ),
        CAN_FD_MESSAGE => fd(body)?,
        CAN_FD_MESSAGE_64 => fd_64(body)?,
        _ => return None,
    };
    Some(Line {
        t_us: ticks.saturating_mul(unit_ns) / 1000,
        device: channel.to_string(),
        frame,
    })
}

fn identifier(raw: u32) -> (u32, bool) {
    (raw & !EXTENDED, raw & EXTENDED != 0)
}

fn classic(body: &[u8]) -> Option<(u16, BusFrame)> {
    let (id, is_extended) = identifier(u32_at(body, 4)?);
    let (flags, length) = (*body.get(2)?, *body.get(3)?);
    let frame = if flags & 0x80 != 0 {
        BusFrame::remote(id, is_extended, length)?
    } else {
        let data = body.get(8..8 + usize::from(length.min(8)))?;
        BusFrame::new(FrameKind::Data, id, is_extended, data)?
    };
    Some((u16_at(body, 0)?, frame))
}

fn fd(body: &[u8]) -> Option<(u16, BusFrame)> {
    let (id, is_extended) = identifier(u32_at(body, 4)?);
    let (flags, valid) = (*body.get(13)?, usize::from(*body.get(14)?));
    let data = body.get(20..20 + valid)?;
    let kind = if flags & 1 != 0 {
        FrameKind::Fd {
            flags: flags >> 1 & 3,
        }
    } else {
        FrameKind::Data
    };
    Some((
        u16_at(body, 0)?,
        BusFrame::new(kind, id, is_extended, data)?,
    ))
}

fn fd_64(body: &[u8]) -> Option<(u16, BusFrame)> {
    let (id, is_extended) = identifier(u32_at(body, 4)?);
    let (valid, flags) = (usize::from(*body.get(2)?), u32_at(body, 12)?);
    let data = body.get(40..40 + valid)?;
    let frame = match flags {
        flags if flags & 0x10 != 0 => BusFrame::remote(id, is_extended, *body.get(1)?)?,
        flags if flags & 0x1000 != 0 => {
            let kind = FrameKind::Fd {
                flags: (flags >> 13 & 3) as u8,
            };
            BusFrame::new(kind, id, is_extended, data)?
        }
        _ => BusFrame::new(FrameKind::Data, id, is_extended, data)?,
    };
    Some((u16::from(*body.first()?), frame))
}
