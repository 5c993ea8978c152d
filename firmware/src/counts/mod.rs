//! Keeps the counts of load cycles in flash over losses of power (`CountKeeper`): a whole state of
//! the counts at the start of an area, then an increment each time; a full area is followed by
//! another one. Areas of other images stay until their place is needed.
//!
//! Each call does one small piece of work: it writes one piece of 256 bytes or erases one page.
//! What a board counts meanwhile is in the next increment.

mod memory;

use embedded_storage::nor_flash::NorFlash;
use loadtwin_common::counting::CountedLoads;
use loadtwin_common::counting::kept::{
    Area, Header, MOST_PIECES, Piece, STATE, VERSION, WORD, Words,
};
use loadtwin_common::image::Image;

pub use memory::CountMemory;

/// Most areas.
pub const MOST_AREAS: usize = 4;

/// Time from one increment to the next (s): below the 60 s of running of which counts may be lost,
/// by more than the second that erasing an area and writing a state take.
pub const INTERVAL_S: f32 = 50.0;

/// How often a piece is written further behind where a word cannot be written, before the area
/// is given up.
const ATTEMPTS: u8 = 4;

/// Where the areas are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CountsLayout {
    /// Offset of the first one; a multiple of the page.
    pub start: u32,
    /// Length of each (bytes), a multiple of the page.
    pub area_bytes: u32,
    /// Number of them, 2 to [`MOST_AREAS`].
    pub areas: usize,
}

impl CountsLayout {
    /// An area by its number.
    pub fn area(&self, number: usize) -> Area {
        let start = self.start + number as u32 * self.area_bytes;
        Area {
            start,
            end: start + self.area_bytes,
        }
    }
}

/// Whose counts an area holds.
#[derive(Clone, Debug, PartialEq)]
pub struct Owner {
    /// What status frames call the image.
    pub image_hash: u32,
    /// Sample rate (Hz).
    pub rate_hz: f32,
    /// The loads that are counted.
    pub counted: CountedLoads,
}

impl Owner {
    /// That of an image.
    pub fn of(image: &Image<'_>, image_hash: u32) -> Self {
        Self {
            image_hash,
            rate_hz: image.rate_hz,
            counted: image.counted.clone(),
        }
    }
}

/// An area with a whole state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Known {
    generation: u32,
    image_hash: u32,
}

/// What is under way.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Work {
    Nothing,
    /// The last piece is written again, for a cut may have touched it.
    Anchor {
        at: u32,
    },
    /// An increment, the next piece.
    Increment {
        pieces: u8,
        index: u8,
    },
    /// An area is erased, the next page.
    Erase {
        target: usize,
        page: u32,
    },
    /// The header of an area is written.
    Header {
        target: usize,
    },
    /// A whole state, the next piece.
    State {
        target: usize,
        index: u8,
    },
}

/// A flash that is read in words.
struct Flash<'a, F>(&'a mut F);

impl<F: NorFlash> Words for Flash<'_, F> {
    fn word(&mut self, at: u32) -> Option<u64> {
        let mut bytes = [0; WORD];
        self.0.read(at, &mut bytes).ok()?;
        Some(u64::from_le_bytes(bytes))
    }
}

/// Writes a piece at `at` and reads it back.
fn write<F: NorFlash>(flash: &mut F, piece: &Piece, at: u32) -> bool {
    piece.words().iter().enumerate().all(|(place, word)| {
        let at = at + (place * WORD) as u32;
        flash.write(at, &word.to_le_bytes()).is_ok() && Flash(flash).word(at) == Some(*word)
    })
}

/// Keeps the counts of one image.
#[derive(Debug)]
pub struct CountKeeper {
    layout: CountsLayout,
    owner: Owner,
    known: [Option<Known>; MOST_AREAS],
    /// Areas whose state was not written whole.
    begun: [bool; MOST_AREAS],
    /// Areas that could not be written.
    failed: [bool; MOST_AREAS],
    /// Highest generation of a header.
    newest: u32,
    /// The area that increments go to.
    current: Option<usize>,
    /// Where the next piece goes.
    free: u32,
    /// Number of the next message.
    message: u16,
    work: Work,
    attempts: u8,
}

impl CountKeeper {
    /// Looks at the areas; reads only.
    pub fn open<F: NorFlash>(flash: &mut F, layout: CountsLayout, owner: Owner) -> Self {
        let mut known = [None; MOST_AREAS];
        let mut begun = [false; MOST_AREAS];
        let mut newest = 0;
        let areas = known.iter_mut().zip(&mut begun).enumerate();
        for (number, (known, begun)) in areas.take(layout.areas) {
            let area = layout.area(number);
            let Some(header) = area.header(&mut Flash(flash)) else {
                continue;
            };
            newest = header.generation.max(newest);
            if area.has_state(&mut Flash(flash), header.generation) {
                *known = Some(Known {
                    generation: header.generation,
                    image_hash: header.image_hash,
                });
            } else {
                *begun = true;
            }
        }
        Self {
            layout,
            owner,
            known,
            begun,
            failed: [false; MOST_AREAS],
            newest,
            current: None,
            free: 0,
            message: 0,
            work: Work::Nothing,
            attempts: 0,
        }
    }

    /// Reads the counts that were kept last; false where there are none. Work is under way then.
    pub fn load<F: NorFlash, const L: usize>(
        &mut self,
        flash: &mut F,
        memory: &mut CountMemory<L>,
    ) -> bool {
        while let Some((number, known)) = self.newest_of_owner() {
            let area = self.layout.area(number);
            let header = area.header(&mut Flash(flash)).filter(|header| {
                header.generation == known.generation && header.counted == self.owner.counted
            });
            let messages = header.and_then(|header| {
                area.load(&mut Flash(flash), &header, &mut memory.counts)
                    .ok()
            });
            if let Some(messages) = messages {
                memory.mark_kept();
                self.current = Some(number);
                self.free = area.free(&mut Flash(flash));
                self.message = messages.last.saturating_add(1);
                self.work = Work::Anchor {
                    at: messages.piece_at,
                };
                return true;
            }
            if let Some(known) = self.known.get_mut(number) {
                *known = None;
            }
        }
        false
    }

    /// Whose counts are kept.
    pub fn owner(&self) -> &Owner {
        &self.owner
    }

    /// Whether work is under way.
    pub fn is_busy(&self) -> bool {
        self.work != Work::Nothing
    }

    /// Begins to keep the counts as they are, where nothing is under way.
    pub fn begin<const L: usize>(&mut self, memory: &mut CountMemory<L>) {
        if self.is_busy() {
            return;
        }
        self.attempts = 0;
        let pieces = self.current.and_then(|_| memory.begin_increment());
        match pieces {
            Some(pieces) => self.work = Work::Increment { pieces, index: 0 },
            None => self.begin_area(),
        }
    }

    /// Does the next piece of work.
    pub fn poll<F: NorFlash, const L: usize>(
        &mut self,
        flash: &mut F,
        memory: &mut CountMemory<L>,
    ) {
        match self.work {
            Work::Nothing => {}
            Work::Anchor { .. } if self.begun.contains(&true) => self.erase_begun(flash),
            Work::Anchor { at } => {
                self.work = Work::Nothing;
                let current = self.current.and_then(|number| {
                    let generation = self.known.get(number).copied().flatten()?.generation;
                    Some((self.layout.area(number), generation))
                });
                let piece = current.and_then(|(area, generation)| {
                    Piece::read(&mut Flash(flash), at, area.end, generation)
                });
                match piece {
                    Some(piece) => match self.write(flash, &piece) {
                        Written::Whole => {}
                        Written::Not => self.work = Work::Anchor { at },
                        Written::NoRoom => self.begin_area(),
                    },
                    // It reads so today and not any more: what was loaded is kept anew.
                    None => self.begin_area(),
                }
            }
            Work::Increment { pieces, index } => {
                let is_last = index + 1 == pieces;
                let content = memory.increment_piece(index);
                let piece = self.piece(self.message, index, is_last, content);
                match self.write(flash, &piece) {
                    Written::Not => {}
                    Written::NoRoom => self.begin_area(),
                    Written::Whole if is_last => {
                        self.message = self.message.saturating_add(1);
                        self.work = Work::Nothing;
                        if !memory.end_increment() {
                            self.begin_area();
                        }
                    }
                    Written::Whole => {
                        self.work = Work::Increment {
                            pieces,
                            index: index + 1,
                        };
                    }
                }
            }
            Work::Erase { target, page } => self.erase(flash, target, page),
            Work::Header { target } => self.write_header(flash, target, memory),
            Work::State { target, index } => self.write_state(flash, target, index, memory),
        }
    }

    /// The newest area of the image whose counts are kept.
    fn newest_of_owner(&self) -> Option<(usize, Known)> {
        let known = self.known.iter().enumerate();
        let of_owner = known.filter_map(|(number, known)| Some((number, (*known)?)));
        of_owner
            .filter(|(_, known)| known.image_hash == self.owner.image_hash)
            .max_by_key(|(_, known)| known.generation)
    }

    /// Erases the header of an area whose state a cut left unfinished: should it read as whole one
    /// day, it would replace increments that were written since.
    fn erase_begun<F: NorFlash>(&mut self, flash: &mut F) {
        let Some(number) = self.begun.iter().position(|begun| *begun) else {
            return;
        };
        if let Some(begun) = self.begun.get_mut(number) {
            *begun = false;
        }
        let at = self.layout.area(number).start;
        if flash.erase(at, at + F::ERASE_SIZE as u32).is_err()
            && let Some(failed) = self.failed.get_mut(number)
        {
            *failed = true;
        }
    }

    /// The area to be written next, other than the one with the newest state: one without counts,
    /// else the oldest that a newer one of the same image replaces, else the oldest; one that
    /// could not be written comes last.
    fn target(&self) -> Option<usize> {
        let kept = self.newest_of_owner().map(|(number, _)| number);
        let rank = |number: usize| {
            if self.failed.get(number) == Some(&true) {
                return (3, 0);
            }
            let Some(Some(known)) = self.known.get(number).copied() else {
                return (0, 0);
            };
            let is_replaced = self.known.iter().flatten().any(|other| {
                other.image_hash == known.image_hash && other.generation > known.generation
            });
            (if is_replaced { 1 } else { 2 }, known.generation)
        };
        (0..self.layout.areas)
            .filter(|number| Some(*number) != kept)
            .min_by_key(|number| rank(*number))
    }

    /// Begins a whole state in another area.
    fn begin_area(&mut self) {
        self.work = match self.target() {
            Some(target) => Work::Erase { target, page: 0 },
            None => Work::Nothing,
        };
        self.attempts = 0;
    }

    fn erase<F: NorFlash>(&mut self, flash: &mut F, target: usize, page: u32) {
        let area = self.layout.area(target);
        let at = area.start + page * F::ERASE_SIZE as u32;
        if at >= area.end {
            self.free = area.start;
            self.work = Work::Header { target };
            return;
        }
        // What it held counts no more from here on.
        if let Some(known) = self.known.get_mut(target) {
            *known = None;
        }
        let erased = flash.erase(at, at + F::ERASE_SIZE as u32);
        self.work = match erased {
            Ok(()) => Work::Erase {
                target,
                page: page + 1,
            },
            Err(_) => self.give_up(target),
        };
    }

    fn write_header<F: NorFlash, const L: usize>(
        &mut self,
        flash: &mut F,
        target: usize,
        memory: &mut CountMemory<L>,
    ) {
        let header = Header {
            version: VERSION,
            generation: self.newest.saturating_add(1),
            image_hash: self.owner.image_hash,
            rate_hz: self.owner.rate_hz,
            counted: self.owner.counted.clone(),
        };
        let area = self.layout.area(target);
        let written = header
            .piece()
            .filter(|piece| write(flash, piece, area.start));
        self.work = match written {
            Some(piece) => {
                self.free = area.start + piece.size();
                self.newest = header.generation;
                memory.mark_kept();
                Work::State { target, index: 0 }
            }
            None => self.give_up(target),
        };
    }

    fn write_state<F: NorFlash, const L: usize>(
        &mut self,
        flash: &mut F,
        target: usize,
        index: u8,
        memory: &CountMemory<L>,
    ) {
        let generation = self.newest;
        let (content, is_last) = memory.state_piece(index);
        let piece = Piece::new(generation, STATE, index, is_last, &content);
        let written = self.write_in(flash, self.layout.area(target), &piece);
        self.work = match written {
            Written::Not => return,
            Written::Whole if is_last => {
                let known = Known {
                    generation,
                    image_hash: self.owner.image_hash,
                };
                if let Some(slot) = self.known.get_mut(target) {
                    *slot = Some(known);
                }
                self.current = Some(target);
                self.message = STATE + 1;
                Work::Nothing
            }
            Written::Whole if usize::from(index) + 1 < MOST_PIECES => Work::State {
                target,
                index: index + 1,
            },
            Written::Whole | Written::NoRoom => self.give_up(target),
        };
    }

    /// The area cannot be written. What was kept before stays, and the next interval begins a state
    /// anew in another one.
    fn give_up(&mut self, target: usize) -> Work {
        self.current = None;
        if let Some(failed) = self.failed.get_mut(target) {
            *failed = true;
        }
        Work::Nothing
    }

    fn piece(&self, message: u16, index: u8, is_last: bool, content: &[u8]) -> Piece {
        let known = self.current.and_then(|number| self.known.get(number));
        let generation = known.copied().flatten().map_or(0, |known| known.generation);
        Piece::new(generation, message, index, is_last, content)
    }

    /// Writes a piece to the area that increments go to.
    fn write<F: NorFlash>(&mut self, flash: &mut F, piece: &Piece) -> Written {
        match self.current {
            Some(current) => self.write_in(flash, self.layout.area(current), piece),
            None => Written::NoRoom,
        }
    }

    /// Writes a piece at the first place that takes it, one place a call.
    fn write_in<F: NorFlash>(&mut self, flash: &mut F, area: Area, piece: &Piece) -> Written {
        let at = self.free;
        if self.attempts >= ATTEMPTS || at.saturating_add(piece.size()) > area.end {
            return Written::NoRoom;
        }
        self.free = at + piece.size();
        if write(flash, piece, at) {
            self.attempts = 0;
            Written::Whole
        } else {
            self.attempts += 1;
            Written::Not
        }
    }
}

/// What became of a piece.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Written {
    Whole,
    /// It was damaged on its way; the next place is tried.
    Not,
    NoRoom,
}
