//! Keeps sealed images in two slots of NOR flash, safe against loss of power (`Store`): chooses the
//! image at start, checks a new one, installs it page by page in the other slot, and puts it in
//! force.
//!
//! A slot is a number of pages for the image and a last page for its commit
//! records. An image is checked as a whole before anything is erased for it,
//! written to the slot that does not run, read back there, and comes into force
//! by one record of 8 bytes: one programming operation. The slot with the valid
//! record of the highest counter and a valid image starts.
//!
//! Where the flash has damaged the image in force since it started, the other
//! slot holds the only image that would start again: it is kept, and the damaged
//! one is written over.
//!
//! A record whose writing was cut may read as valid today and not tomorrow. So
//! records come in pairs, written in one go: where the second place is not
//! blank, the first was completed. Before a slot is erased, the one that is
//! kept is given such a pair (`anchor`); a pair once begun is not continued
//! after a cut, the next one is taken. Starting writes nothing.
//!
//! The flash's `read` must return an error for a word that its ECC cannot
//! correct, not fault: a cut leaves such words (on the STM32G4: NMI with
//! `FLASH_ECCR.ECCD`, to be caught by the board).

mod records;

use embedded_storage::nor_flash::NorFlash;
use loadtwin_common::Error;
use loadtwin_common::io::signed_image;
use loadtwin_common::io::signed_image::{HEADER_LEN, Header, Identity, ImageError, PayloadHash};

use records::RECORD_LEN;

/// Bytes read from the flash at once.
const CHUNK: usize = 256;
/// How often an image is read before it counts as intact. A word that its ECC corrects in one
/// read of four (as seen after cuts) passes all of them with a probability of 6e-8.
const READS: u32 = 12;

/// Where the slots are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Offset of slot A; slot B follows it. A multiple of the page.
    pub start: u32,
    /// Length of a slot (bytes), at least two pages; the last one is for records.
    pub slot_bytes: u32,
}

/// One of the two slots.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Slot {
    /// At the start of the layout.
    A,
    /// Behind slot A.
    B,
}

impl Slot {
    fn other(self) -> Self {
        match self {
            Self::A => Self::B,
            Self::B => Self::A,
        }
    }
}

/// The image in force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Active {
    /// Where it is.
    pub slot: Slot,
    /// Its header.
    pub header: Header,
    /// Offset of its payload in the flash, `header.length` bytes.
    pub payload: u32,
    counter: u32,
}

/// An image on its way into the flash.
#[derive(Clone, Copy, Debug)]
struct Incoming {
    slot: Slot,
    header: Header,
    image_len: u32,
    written: u32,
}

/// The two slots.
#[derive(Debug)]
pub struct Store<F> {
    flash: F,
    layout: Layout,
    board: Option<Identity>,
    active: Option<Active>,
    /// Survives the installation under way.
    kept: Option<Active>,
    incoming: Option<Incoming>,
    target: Option<Slot>,
    restart_pending: bool,
    passed_over: Option<ImageError>,
}

impl<F: NorFlash> Store<F> {
    /// Smallest part of the flash that is erased [bytes].
    const PAGE: u32 = F::ERASE_SIZE as u32;

    /// Finds the image to run. Reads only.
    ///
    /// `accept` checks a payload, `length` bytes at an offset of the flash, by
    /// what the container does not know: the model's version and ranges, the hardware. An
    /// image that is damaged, not signed for `board` or not accepted is passed
    /// over for the older one. Without an identity none starts.
    ///
    /// # Errors
    /// `Error::OutOfRange` when the layout does not fit the flash.
    pub fn boot(
        flash: F,
        layout: Layout,
        board: Option<Identity>,
        mut accept: impl FnMut(&mut F, u32, u32) -> Result<(), ImageError>,
    ) -> Result<Self, Error> {
        const {
            assert!(
                RECORD_LEN.is_multiple_of(F::WRITE_SIZE) && RECORD_LEN.is_multiple_of(F::READ_SIZE)
            );
            assert!(F::ERASE_SIZE.is_multiple_of(CHUNK) && F::ERASE_SIZE >= HEADER_LEN);
        }
        if !layout.start.is_multiple_of(Self::PAGE) {
            return Err(Error::OutOfRange("start"));
        }
        let end = layout
            .slot_bytes
            .checked_mul(2)
            .and_then(|n| n.checked_add(layout.start));
        if !layout.slot_bytes.is_multiple_of(Self::PAGE)
            || layout.slot_bytes < 2 * Self::PAGE
            || end.is_none_or(|end| end as usize > flash.capacity())
        {
            return Err(Error::OutOfRange("slot_bytes"));
        }
        let mut store = Self {
            flash,
            layout,
            board,
            active: None,
            kept: None,
            incoming: None,
            target: None,
            restart_pending: false,
            passed_over: None,
        };
        let a = store.candidate(Slot::A);
        let b = store.candidate(Slot::B);
        let newer_first = match (a, b) {
            (Some(x), Some(y)) if y.counter > x.counter => [b, a],
            _ => [a, b],
        };
        for candidate in newer_first.into_iter().flatten() {
            match store.check(candidate.slot, &candidate.header, &mut accept) {
                Ok(()) => {
                    store.active = Some(candidate);
                    break;
                }
                Err(refusal) => store.passed_over = store.passed_over.or(Some(refusal)),
            }
        }
        Ok(store)
    }

    /// The image in force; after [`Store::finish`] the one that starts next.
    pub fn active(&self) -> Option<&Active> {
        self.active.as_ref()
    }

    /// Why the newest image that was once accepted does not run.
    pub fn passed_over(&self) -> Option<ImageError> {
        self.passed_over
    }

    /// What images are checked with.
    pub fn board(&self) -> Option<&Identity> {
        self.board.as_ref()
    }

    /// The flash.
    pub fn flash(&self) -> &F {
        &self.flash
    }

    /// The flash, to read a payload from.
    pub fn flash_mut(&mut self) -> &mut F {
        &mut self.flash
    }

    /// Gives the flash back.
    pub fn release(self) -> F {
        self.flash
    }

    /// Longest image that fits (bytes).
    pub fn image_capacity(&self) -> u32 {
        self.layout.slot_bytes - Self::PAGE
    }

    /// Whether an image was accepted and waits for a restart. Until then no
    /// other is taken: the model still running may be read from the other slot.
    pub fn restart_pending(&self) -> bool {
        self.restart_pending
    }

    /// Checks the start of an image: whether the whole may be installed. Reads and writes nothing.
    ///
    /// `first`: at least the image's header; `image_len`: as announced.
    ///
    /// # Errors
    /// Any reason that the header gives; `BadLength` when it does not fit
    /// `image_len`; `TooLong`; `RestartPending`.
    pub fn check_header(&self, first: &[u8], image_len: u32) -> Result<Header, ImageError> {
        if self.restart_pending {
            return Err(ImageError::RestartPending);
        }
        let header = Header::parse(first)?;
        if header.image_len() != Some(image_len) {
            return Err(ImageError::BadLength);
        }
        if image_len > self.image_capacity() {
            return Err(ImageError::TooLong);
        }
        header.verify(self.board.as_ref())?;
        header.may_replace(self.active.as_ref().map(|a| &a.header))?;
        Ok(header)
    }

    /// Checks a whole image and chooses its slot. Nothing is erased yet.
    ///
    /// `accept` checks the payload as for [`Store::boot`].
    ///
    /// # Errors
    /// As [`Store::check_header`]; `BadLength`, `BadCrc`, `BadDigest`, and what `accept` refuses.
    pub fn begin(
        &mut self,
        image: &[u8],
        accept: impl FnOnce(&[u8]) -> Result<(), ImageError>,
    ) -> Result<(), ImageError> {
        self.incoming = None;
        let image_len = u32::try_from(image.len()).map_err(|_| ImageError::TooLong)?;
        let header = self.check_header(image, image_len)?;
        let (_, payload) = signed_image::open(image)?;
        accept(payload)?;
        self.kept = self.kept();
        let slot = self.kept.map_or(Slot::A, |kept| kept.slot.other());
        self.target = Some(slot);
        self.incoming = Some(Incoming {
            slot,
            header,
            image_len,
            written: 0,
        });
        Ok(())
    }

    /// Installs the next page of an image that [`Store::begin`] has taken; `true` after the last.
    ///
    /// `image`: the whole image, as it was given to `begin`.
    ///
    /// # Errors
    /// `BadLength` without a `begin`, `Flash`. The installation is over then.
    pub fn install_page(&mut self, image: &[u8]) -> Result<bool, ImageError> {
        let mut incoming = self.incoming.take().ok_or(ImageError::BadLength)?;
        if incoming.written == 0 {
            self.prepare(&incoming)?;
        }
        let rest = (image.get(incoming.written as usize..)).ok_or(ImageError::BadLength)?;
        let piece = rest.get(..F::ERASE_SIZE).unwrap_or(rest);
        let at = self.start(incoming.slot) + incoming.written;
        self.erase(at)?;
        let (words, last) = piece.as_chunks::<RECORD_LEN>();
        let whole = piece.get(..words.len() * RECORD_LEN).unwrap_or_default();
        if !whole.is_empty() {
            self.flash.write(at, whole).map_err(|_| ImageError::Flash)?;
        }
        if !last.is_empty() {
            let mut word = [0xFF; RECORD_LEN];
            for (w, l) in word.iter_mut().zip(last) {
                *w = *l;
            }
            self.flash
                .write(at + whole.len() as u32, &word)
                .map_err(|_| ImageError::Flash)?;
        }
        incoming.written += piece.len() as u32;
        self.incoming = Some(incoming);
        Ok(incoming.written >= incoming.image_len)
    }

    /// Checks the image as it stands in the flash and puts it in force.
    ///
    /// # Errors
    /// `BadLength` when pages are missing, `Flash` when it does not stand there as it was given.
    /// The installation is over then.
    pub fn finish(&mut self) -> Result<Active, ImageError> {
        let incoming = self.incoming.take().ok_or(ImageError::BadLength)?;
        if incoming.written < incoming.image_len {
            return Err(ImageError::BadLength);
        }
        if !self.is_intact(incoming.slot, &incoming.header) {
            return Err(ImageError::Flash);
        }
        let active = Active {
            slot: incoming.slot,
            header: incoming.header,
            payload: self.start(incoming.slot) + HEADER_LEN as u32,
            counter: self.newest_counter(incoming.slot)?.saturating_add(1),
        };
        if self.append(&active, 0).is_err() {
            // A record that could not be read back now must not be found later.
            let _ = self.erase(self.records_at(incoming.slot));
            return Err(ImageError::Flash);
        }
        self.active = Some(active);
        self.restart_pending = true;
        Ok(active)
    }

    /// Highest counter of a record that may start an image beside the one in `written`.
    ///
    /// Where no image is in force, the other slot may hold one that cannot be read now and can be
    /// later. Its counter is exceeded; where that cannot be read either, its records are erased.
    fn newest_counter(&mut self, written: Slot) -> Result<u32, ImageError> {
        let known = self.active.iter().chain(&self.kept).map(|a| a.counter);
        if let Some(newest) = known.max() {
            return Ok(newest);
        }
        let other = written.other();
        if let Some(unusable) = self.candidate(other) {
            return Ok(unusable.counter);
        }
        self.erase(self.records_at(other))?;
        Ok(0)
    }

    /// The slot that an installation under way, or the last one, writes.
    pub fn installed(&self) -> Option<Slot> {
        self.target
    }

    /// Gives an installation up.
    pub fn abandon(&mut self) {
        self.incoming = None;
    }

    /// The image that must survive an installation: the one in force, or, where the flash has
    /// damaged that one since it started, the one in the other slot.
    fn kept(&mut self) -> Option<Active> {
        let active = self.active?;
        if self.is_intact(active.slot, &active.header) {
            return Some(active);
        }
        let other = self.candidate(active.slot.other());
        let other = other.filter(|o| o.header.verify(self.board.as_ref()).is_ok());
        other
            .filter(|other| self.is_intact(other.slot, &other.header))
            .or(Some(active))
    }

    /// Makes sure that the kept image starts whatever happens, and erases the records of the slot
    /// that is written.
    fn prepare(&mut self, incoming: &Incoming) -> Result<(), ImageError> {
        if let Some(kept) = self.kept {
            self.anchor(&kept)?;
        }
        self.erase(self.records_at(incoming.slot))?;
        if self.records(incoming.slot, &incoming.header).free == 0 {
            Ok(())
        } else {
            Err(ImageError::Flash)
        }
    }

    fn start(&self, slot: Slot) -> u32 {
        match slot {
            Slot::A => self.layout.start,
            Slot::B => self.layout.start + self.layout.slot_bytes,
        }
    }

    fn records_at(&self, slot: Slot) -> u32 {
        self.start(slot) + self.layout.slot_bytes - Self::PAGE
    }

    fn erase(&mut self, page: u32) -> Result<(), ImageError> {
        self.flash
            .erase(page, page + Self::PAGE)
            .map_err(|_| ImageError::Flash)
    }

    fn candidate(&mut self, slot: Slot) -> Option<Active> {
        let header = self.read_header(slot).ok()?;
        let counter = self.records(slot, &header).counter?;
        let payload = self.start(slot) + HEADER_LEN as u32;
        Some(Active {
            slot,
            header,
            payload,
            counter,
        })
    }

    fn read_header(&mut self, slot: Slot) -> Result<Header, ImageError> {
        let mut bytes = [0; HEADER_LEN.next_multiple_of(RECORD_LEN)];
        self.flash
            .read(self.start(slot), &mut bytes)
            .map_err(|_| ImageError::Flash)?;
        let header = Header::parse(&bytes)?;
        match header.image_len() {
            Some(n) if n <= self.image_capacity() => Ok(header),
            _ => Err(ImageError::TooLong),
        }
    }

    fn check(
        &mut self,
        slot: Slot,
        header: &Header,
        accept: &mut impl FnMut(&mut F, u32, u32) -> Result<(), ImageError>,
    ) -> Result<(), ImageError> {
        header.verify(self.board.as_ref())?;
        self.judge_content(slot, header, accept)
    }

    /// Checks the content of a slot by a header whose signature was verified.
    fn judge_content(
        &mut self,
        slot: Slot,
        header: &Header,
        accept: &mut impl FnMut(&mut F, u32, u32) -> Result<(), ImageError>,
    ) -> Result<(), ImageError> {
        self.check_content(slot, header)?;
        let payload = self.start(slot) + HEADER_LEN as u32;
        accept(&mut self.flash, payload, header.length)
    }

    /// Whether what stands in a slot is what `header` was signed for, each time it is read.
    fn is_intact(&mut self, slot: Slot, header: &Header) -> bool {
        (0..READS).all(|_| self.check_content(slot, header).is_ok())
    }

    fn check_content(&mut self, slot: Slot, header: &Header) -> Result<(), ImageError> {
        if self.read_header(slot)? != *header {
            return Err(ImageError::BadDigest);
        }
        let start = self.start(slot);
        let payload = HEADER_LEN as u32;
        let end = payload.saturating_add(header.length);
        let mut content = PayloadHash::new(header);
        let mut crc = [0; 4];
        let mut chunk = [0; CHUNK];
        let mut at = 0;
        // Whole chunks from the start of the slot: aligned for any READ_SIZE.
        while at < end + 4 {
            self.flash
                .read(start + at, &mut chunk)
                .map_err(|_| ImageError::Flash)?;
            let head = payload.saturating_sub(at) as usize;
            content.hash(chunk.get(head..).unwrap_or_default());
            for (i, byte) in crc.iter_mut().enumerate() {
                if let Some(b) = (end + i as u32)
                    .checked_sub(at)
                    .and_then(|k| chunk.get(k as usize))
                {
                    *byte = *b;
                }
            }
            at += CHUNK as u32;
        }
        content.finish(u32::from_le_bytes(crc))
    }
}
