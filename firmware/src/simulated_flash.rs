//! Simulates NOR flash in RAM (`SimulatedFlash`) for tests of the store: power failures within an
//! operation, ECC errors, flipped and stuck bits.
//!
//! It behaves as the flash of the STM32G4: words of 8 bytes that are programmed
//! once after an erase, erased in pages. A cut leaves the word or the page that
//! was at work half done: each bit old, new, or reading differently every time,
//! and words whose ECC may fail to correct them.

use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash, check_erase, check_read,
    check_write,
};

/// Bytes programmed at once.
pub const WORD: usize = 8;

/// When, in the course of an operation, the power fails.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moment {
    /// Nothing of it was done.
    Before,
    /// It was under way.
    Inside,
    /// It was done, and nothing after it.
    After,
}

/// Why an operation failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlashError {
    /// The arguments do not fit the flash.
    Arguments(NorFlashErrorKind),
    /// The power is off.
    NoPower,
    /// The word is not blank.
    NotBlank,
    /// The word cannot be corrected.
    Ecc,
}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Arguments(kind) => *kind,
            _ => NorFlashErrorKind::Other,
        }
    }
}

#[derive(Clone, Copy, Debug)]
struct Word {
    /// Bits as they stand.
    value: u64,
    /// Bits that read differently every time.
    flaky: u64,
    /// Left by a cut: its ECC bits may not fit.
    torn: bool,
}

const ERASED: Word = Word {
    value: u64::MAX,
    flaky: 0,
    torn: false,
};

/// A flash of `WORDS` words in pages of `PAGE` bytes.
#[derive(Clone, Debug)]
pub struct SimulatedFlash<const PAGE: usize, const WORDS: usize> {
    words: [Word; WORDS],
    /// Cells of each word that always read as 0, and as 1.
    stuck: [(u64, u64); WORDS],
    random: u64,
    powered: bool,
    cut: Option<(u32, Moment)>,
    operations: u32,
}

impl<const PAGE: usize, const WORDS: usize> SimulatedFlash<PAGE, WORDS> {
    /// An erased flash; the seed decides what cuts leave behind.
    pub fn new(seed: u64) -> Self {
        Self {
            words: [ERASED; WORDS],
            stuck: [(0, 0); WORDS],
            random: seed | 1,
            powered: true,
            cut: None,
            operations: 0,
        }
    }

    /// Lets the power fail at the `operation`-th write of a word or erase of a
    /// page from now, counted from 0.
    pub fn cut_at(&mut self, operation: u32, moment: Moment) {
        self.cut = Some((operation, moment));
    }

    /// Switches the power on again; a cut not reached yet is called off.
    pub fn power_on(&mut self) {
        self.powered = true;
        self.cut = None;
    }

    /// Whether the power is on.
    pub fn is_powered(&self) -> bool {
        self.powered
    }

    /// Writes of a word and erases of a page done or begun so far.
    pub fn operations(&self) -> u32 {
        self.operations
    }

    /// Flips a bit of a word, as charge that leaks does; reads do not report it.
    pub fn flip(&mut self, word: usize, bit: u32) {
        if let Some(word) = self.words.get_mut(word) {
            word.value ^= 1 << (bit % 64);
        }
    }

    /// Makes a word read differently every time, and most of the time not at all.
    pub fn weaken(&mut self, word: usize) {
        let flaky = self.random();
        if let Some(word) = self.words.get_mut(word) {
            word.flaky = flaky;
            word.torn = true;
        }
    }

    /// Lets a cell of a word always read as `bit_value`, whatever is written.
    pub fn stick(&mut self, word: usize, bit: u32, bit_value: bool) {
        if let Some((low, high)) = self.stuck.get_mut(word) {
            let mask = 1 << (bit % 64);
            *(if bit_value { high } else { low }) |= mask;
        }
    }

    /// Takes another seed for what comes.
    pub fn reseed(&mut self, seed: u64) {
        self.random = seed | 1;
    }

    /// xorshift64* (Vigna 2016).
    fn random(&mut self) -> u64 {
        self.random ^= self.random >> 12;
        self.random ^= self.random << 25;
        self.random ^= self.random >> 27;
        self.random.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    /// Starts an operation: what happens to it, `None` when all goes well.
    fn fate(&mut self) -> Result<Option<Moment>, FlashError> {
        if !self.powered {
            return Err(FlashError::NoPower);
        }
        self.operations = self.operations.wrapping_add(1);
        match self.cut {
            Some((0, moment)) => {
                self.powered = false;
                self.cut = None;
                Ok(Some(moment))
            }
            Some((n, moment)) => {
                self.cut = Some((n - 1, moment));
                Ok(None)
            }
            None => Ok(None),
        }
    }

    /// A word on its way from `old` to `new`.
    fn torn(&mut self, old: Word, new: u64) -> Word {
        let changed = (old.value ^ new) | old.flaky;
        match self.random() % 8 {
            // Hardly begun; just about done; done but weak in every bit.
            0 => Word { torn: true, ..old },
            1 => Word {
                value: new,
                flaky: 0,
                torn: true,
            },
            2 => Word {
                value: new,
                flaky: changed,
                torn: true,
            },
            _ => {
                let done = self.random();
                let flaky = changed & self.random() & self.random();
                Word {
                    value: (old.value & !(changed & done)) | (new & changed & done),
                    flaky,
                    torn: true,
                }
            }
        }
    }

    fn stuck_low(&self, index: usize) -> u64 {
        self.stuck.get(index).map_or(0, |(low, _)| *low)
    }

    fn program(&mut self, index: usize, new: u64) -> Result<(), FlashError> {
        let fate = self.fate()?;
        let old = self
            .words
            .get(index)
            .copied()
            .ok_or(FlashError::Arguments(NorFlashErrorKind::OutOfBounds))?;
        let word = match fate {
            Some(Moment::Before) => return Err(FlashError::NoPower),
            Some(Moment::Inside) => {
                let new = new & old.value;
                self.torn(old, new)
            }
            _ if old.value & !self.stuck_low(index) != u64::MAX
                || old.flaky & self.random() != 0 =>
            {
                return Err(FlashError::NotBlank);
            }
            _ => Word {
                value: new,
                flaky: old.flaky & new,
                torn: old.flaky & new != 0,
            },
        };
        if let Some(w) = self.words.get_mut(index) {
            *w = word;
        }
        if fate.is_some() {
            Err(FlashError::NoPower)
        } else {
            Ok(())
        }
    }

    fn erase_page(&mut self, first: usize) -> Result<(), FlashError> {
        let fate = self.fate()?;
        for index in first..first + PAGE / WORD {
            let old = self.words.get(index).copied().unwrap_or(ERASED);
            let word = match fate {
                Some(Moment::Before) => old,
                Some(Moment::Inside) => self.torn(old, u64::MAX),
                _ => ERASED,
            };
            if let Some(w) = self.words.get_mut(index) {
                *w = word;
            }
        }
        if fate.is_some() {
            Err(FlashError::NoPower)
        } else {
            Ok(())
        }
    }
}

impl<const PAGE: usize, const WORDS: usize> ErrorType for SimulatedFlash<PAGE, WORDS> {
    type Error = FlashError;
}

impl<const PAGE: usize, const WORDS: usize> ReadNorFlash for SimulatedFlash<PAGE, WORDS> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        check_read(self, offset, bytes.len()).map_err(FlashError::Arguments)?;
        if !self.powered {
            return Err(FlashError::NoPower);
        }
        let mut at = offset as usize;
        let mut rest = bytes;
        while !rest.is_empty() {
            let word = self.words.get(at / WORD).copied().unwrap_or(ERASED);
            let mut value = word.value;
            if word.torn {
                if self.random().is_multiple_of(4) && word.value != u64::MAX {
                    return Err(FlashError::Ecc);
                }
                value ^= word.flaky & self.random();
            }
            let (low, high) = self.stuck.get(at / WORD).copied().unwrap_or_default();
            value = value & !low | high;
            let from = at % WORD;
            let (now, later) = rest.split_at_mut(rest.len().min(WORD - from));
            for (b, v) in now
                .iter_mut()
                .zip(value.to_le_bytes().into_iter().skip(from))
            {
                *b = v;
            }
            at += now.len();
            rest = later;
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        WORDS * WORD
    }
}

impl<const PAGE: usize, const WORDS: usize> NorFlash for SimulatedFlash<PAGE, WORDS> {
    const WRITE_SIZE: usize = WORD;
    const ERASE_SIZE: usize = PAGE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        check_erase(self, from, to).map_err(FlashError::Arguments)?;
        for page in (from as usize..to as usize).step_by(PAGE) {
            self.erase_page(page / WORD)?;
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        check_write(self, offset, bytes.len()).map_err(FlashError::Arguments)?;
        for (i, word) in bytes.as_chunks::<WORD>().0.iter().enumerate() {
            self.program(offset as usize / WORD + i, u64::from_le_bytes(*word))?;
        }
        Ok(())
    }
}
