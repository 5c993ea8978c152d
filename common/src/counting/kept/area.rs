//! Reads an area of flash with kept counts (`Area`): its header, then messages in pieces, the first a
//! whole state and the others increments; finds the messages that were written whole, and where the
//! next one goes.
//!
//! A message that was begun again after a loss of power replaces the one before it of the same
//! number. So what a cut left half written, and reads as valid today and not tomorrow, never stands
//! between two messages that were written after it.

use serde::{Deserialize, Serialize};

use super::Words;
use super::piece::{BLANK, CONTENT, Piece, WORD};
use crate::Error;
use crate::counting::{ByteSource, CountedLoads, MachineCounts};

/// Number of the message that is a whole state; 0 is the header.
pub const STATE: u16 = 1;

/// Version of the layout; areas of another one are not read.
pub const VERSION: u8 = 1;

/// What an area says of itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Header {
    /// Version of the layout.
    pub version: u8,
    /// Higher than that of every area written before.
    pub generation: u32,
    /// What status frames call the image.
    pub image_hash: u32,
    /// Sample rate (Hz).
    pub rate_hz: f32,
    /// The loads that are counted.
    pub counted: CountedLoads,
}

impl Header {
    /// Its piece.
    pub fn piece(&self) -> Option<Piece> {
        let mut room = [0; CONTENT];
        let content = postcard::to_slice(self, &mut room).ok()?;
        Some(Piece::new(0, 0, 0, true, content))
    }
}

/// An area of flash.
#[derive(Clone, Copy, Debug)]
pub struct Area {
    /// Its first byte.
    pub start: u32,
    /// Behind its last byte.
    pub end: u32,
}

/// The messages of an area that were written whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Messages {
    /// Number of the last one.
    pub last: u16,
    /// Where its last piece is.
    pub piece_at: u32,
}

/// A message on its way through the pieces of an area.
#[derive(Clone, Copy, Debug)]
struct Pending {
    message: u16,
    start: u32,
    next: u8,
    is_whole: bool,
    /// Its last piece so far.
    piece_at: u32,
}

impl Area {
    /// What it says of itself, where it can be read.
    pub fn header<F: Words>(self, flash: &mut F) -> Option<Header> {
        let piece = Piece::read(flash, self.start, self.end, 0)?;
        let mut room = [0; CONTENT];
        let mut length = 0;
        for (place, byte) in room.iter_mut().enumerate() {
            let Some(found) = piece.byte(place) else {
                break;
            };
            *byte = found;
            length += 1;
        }
        let header: Header = postcard::from_bytes(room.get(..length)?).ok()?;
        let is = header.version == VERSION && piece.message == 0;
        is.then_some(header)
    }

    /// Gives each message that was written whole to `take`, with its number and its bytes, as long
    /// as it returns true; the last message, where there is one at least.
    pub fn messages<F: Words>(
        self,
        flash: &mut F,
        generation: u32,
        mut take: impl FnMut(u16, &mut MessageBytes<'_, F>) -> bool,
    ) -> Option<Messages> {
        let mut at = self.start;
        let mut pending: Option<Pending> = None;
        let mut taken = None;
        let mut give = |flash: &mut F, whole: Pending| {
            let mut bytes = MessageBytes {
                flash,
                area: self,
                generation,
                message: whole.message,
                at: whole.start,
                next: 0,
                piece: None,
                place: 0,
            };
            take(whole.message, &mut bytes)
        };
        while let Some((found, piece)) = next_piece(flash, &mut at, self.end, generation) {
            let begins = piece.index == 0;
            let begun = Pending {
                message: piece.message,
                start: found,
                next: 1,
                is_whole: piece.is_last,
                piece_at: found,
            };
            match &mut pending {
                None if begins && piece.message == STATE => pending = Some(begun),
                Some(now) if begins && piece.message == now.message => *now = begun,
                Some(now)
                    if begins
                        && now.is_whole
                        && piece.message.checked_sub(1) == Some(now.message) =>
                {
                    let whole = *now;
                    if !give(flash, whole) {
                        return taken;
                    }
                    taken = Some(Messages {
                        last: whole.message,
                        piece_at: whole.piece_at,
                    });
                    *now = begun;
                }
                Some(now) if piece.message == now.message && piece.index == now.next => {
                    now.next += 1;
                    now.is_whole = piece.is_last;
                    now.piece_at = found;
                }
                _ => {}
            }
        }
        if let Some(whole) = pending.filter(|pending| pending.is_whole)
            && give(flash, whole)
        {
            taken = Some(Messages {
                last: whole.message,
                piece_at: whole.piece_at,
            });
        }
        taken
    }

    /// Whether it holds a whole state.
    pub fn has_state<F: Words>(self, flash: &mut F, generation: u32) -> bool {
        let mut has = false;
        self.messages(flash, generation, |_, _| {
            has = true;
            false
        });
        has
    }

    /// Reads the counts from it; the last message that they have.
    ///
    /// # Errors
    /// `Error::Malformed` where there are none.
    pub fn load<F: Words, const L: usize>(
        self,
        flash: &mut F,
        header: &Header,
        counts: &mut MachineCounts<L>,
    ) -> Result<Messages, Error> {
        // What fails is left out, with all behind it.
        let mut limit = u16::MAX;
        loop {
            counts.begin(&header.counted)?;
            let mut failed = None;
            let messages = self.messages(flash, header.generation, |message, bytes| {
                if message >= limit {
                    return false;
                }
                let all = counts.loads_mut().iter_mut();
                let mut added = all.map(|counts| counts.add_increment(bytes));
                let is = added.all(|added| added.is_ok()) && bytes.take().is_none();
                if !is {
                    failed = Some(message);
                }
                is
            });
            match (failed, messages) {
                (None, Some(messages)) => return Ok(messages),
                (Some(failed), _) if failed > STATE => limit = failed,
                _ => return Err(Error::Malformed("kept counts")),
            }
        }
    }

    /// Behind all that was written: blank to the end, but for a word that a cut may have touched.
    pub fn free<F: Words>(self, flash: &mut F) -> u32 {
        let mut free = self.end;
        // Each of three times that it is read: what a cut left may read otherwise.
        let mut is_blank = |at| (0..3).all(|_| flash.word(at) == Some(BLANK));
        while free > self.start && is_blank(free - WORD as u32) {
            free -= WORD as u32;
        }
        (free + WORD as u32).min(self.end)
    }
}

/// The next piece from `at` on, and where it was; `at` is behind it then.
fn next_piece<F: Words>(
    flash: &mut F,
    at: &mut u32,
    end: u32,
    generation: u32,
) -> Option<(u32, Piece)> {
    while *at < end {
        let found = *at;
        if let Some(piece) = Piece::read(flash, found, end, generation) {
            *at += piece.size();
            return Some((found, piece));
        }
        *at += WORD as u32;
    }
    None
}

/// The bytes of a message, in pieces that may have others between them.
#[derive(Debug)]
pub struct MessageBytes<'a, F> {
    flash: &'a mut F,
    area: Area,
    generation: u32,
    message: u16,
    at: u32,
    next: u8,
    piece: Option<Piece>,
    place: usize,
}

impl<F: Words> ByteSource for MessageBytes<'_, F> {
    fn take(&mut self) -> Option<u8> {
        loop {
            if let Some(piece) = &self.piece {
                if let Some(byte) = piece.byte(self.place) {
                    self.place += 1;
                    return Some(byte);
                }
                if piece.is_last {
                    return None;
                }
            }
            let (_, piece) = next_piece(self.flash, &mut self.at, self.area.end, self.generation)?;
            if piece.message == self.message && piece.index == self.next {
                self.next += 1;
                self.place = 0;
                self.piece = Some(piece);
            }
        }
    }
}
