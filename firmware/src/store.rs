//! Two slots for sealed images in NOR flash, safe against loss of power.
//!
//! A slot is a number of pages for the image and a last page for its commit
//! records. An image is written to the slot that does not run, read back and
//! judged there, and comes into force by one record of 8 bytes: one
//! programming operation. The slot with the valid record of the highest counter
//! and a valid image starts.
//!
//! A record whose writing was cut may read as valid today and not tomorrow. So
//! records come in pairs, written in one go: where the second place is not
//! blank, the first was completed. Before the other slot is erased, the running
//! slot is given such a pair (`anchor`); a pair once begun is not continued
//! after a cut, the next one is taken. Starting writes nothing.
//!
//! The flash's `read` must return an error for a word that its ECC cannot
//! correct, not fault: a cut leaves such words (on the STM32G4: NMI with
//! `FLASH_ECCR.ECCD`, to be caught by the board).

use embedded_storage::nor_flash::NorFlash;
use loadtwin_common::Error;
use loadtwin_common::sealed::{CRC, Content, HEADER_LEN, Header, PublicKey, Refusal};

/// Length of a commit record [bytes]: counter and CRC-32 over the counter and
/// the signature of the image, little endian.
const RECORD_LEN: usize = 8;
/// A record's place after an erase.
const BLANK: [u8; RECORD_LEN] = [0xFF; RECORD_LEN];
/// Bytes read from the flash at once.
const CHUNK: usize = 256;

/// Where the slots are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Layout {
    /// Offset of slot A; slot B follows it. A multiple of the page.
    pub start: u32,
    /// Length of a slot [bytes], at least two pages; the last one is for records.
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

/// What the record page of a slot says.
#[derive(Clone, Copy, Debug, Default)]
struct Records {
    counter: Option<u32>,
    anchored: bool,
    /// First pair with nothing but blank pairs from there on.
    free: u32,
}

/// The two slots.
#[derive(Debug)]
pub struct Store<F> {
    flash: F,
    layout: Layout,
    key: Option<PublicKey>,
    active: Option<Active>,
    incoming: Option<Incoming>,
    restart_pending: bool,
    passed_over: Option<Refusal>,
}

impl<F: NorFlash> Store<F> {
    const PAGE: u32 = F::ERASE_SIZE as u32;
    const PAIRS: u32 = Self::PAGE / (2 * RECORD_LEN as u32);

    /// Finds the image to run. Reads only.
    ///
    /// `accept` judges a payload, `length` bytes at an offset of the flash, by
    /// what the container does not know: the model's version and ranges. An
    /// image that is damaged, not signed with `key` or not accepted is passed
    /// over for the older one. Without a key none starts.
    ///
    /// # Errors
    /// `Error::OutOfRange` when the layout does not fit the flash.
    pub fn boot(
        flash: F,
        layout: Layout,
        key: Option<PublicKey>,
        mut accept: impl FnMut(&mut F, u32, u32) -> bool,
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
            key,
            active: None,
            incoming: None,
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
            match store.judge(candidate.slot, &candidate.header, &mut accept) {
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
    pub fn passed_over(&self) -> Option<Refusal> {
        self.passed_over
    }

    /// The key that images are checked with.
    pub fn key(&self) -> Option<&PublicKey> {
        self.key.as_ref()
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

    /// Longest image that fits [bytes].
    pub fn image_capacity(&self) -> u32 {
        self.layout.slot_bytes - Self::PAGE
    }

    /// Whether an image was accepted and waits for a restart. Until then no
    /// other is taken: the model still running may be read from the other slot.
    pub fn restart_pending(&self) -> bool {
        self.restart_pending
    }

    /// Judges the start of an image and makes room for it in the slot that does
    /// not run. Nothing is erased for an image that is refused.
    ///
    /// `first`: at least the image's header; `image_len`: as announced.
    ///
    /// # Errors
    /// Any reason that the header gives; `BadLength` when it does not fit
    /// `image_len`; `TooLong`; `RestartPending`; `Flash`.
    pub fn begin(&mut self, first: &[u8], image_len: u32) -> Result<(), Refusal> {
        self.incoming = None;
        if self.restart_pending {
            return Err(Refusal::RestartPending);
        }
        let header = Header::parse(first)?;
        if header.image_len() != Some(image_len) {
            return Err(Refusal::BadLength);
        }
        if image_len > self.image_capacity() {
            return Err(Refusal::TooLong);
        }
        header.verify(self.key.as_ref())?;
        header.may_replace(self.active.as_ref().map(|a| &a.header))?;
        if let Some(active) = self.active {
            self.anchor(&active)?;
        }
        let slot = self.active.map_or(Slot::A, |a| a.slot.other());
        self.erase(self.records_at(slot))?;
        if self.records(slot, &header).free != 0 {
            return Err(Refusal::Flash);
        }
        self.incoming = Some(Incoming {
            slot,
            header,
            image_len,
            written: 0,
        });
        Ok(())
    }

    /// Writes the next page of the image; all but the last are whole pages.
    ///
    /// # Errors
    /// `BadLength` for a piece that is not the image's next page, `Flash`. The
    /// upload is over then.
    pub fn write(&mut self, piece: &[u8]) -> Result<(), Refusal> {
        let Some(mut incoming) = self.incoming.take() else {
            return Err(Refusal::BadLength);
        };
        let wanted = incoming
            .image_len
            .saturating_sub(incoming.written)
            .min(Self::PAGE);
        if wanted == 0 || piece.len() != wanted as usize {
            return Err(Refusal::BadLength);
        }
        let at = self.start(incoming.slot) + incoming.written;
        self.erase(at)?;
        let (words, rest) = piece.as_chunks::<RECORD_LEN>();
        let whole = piece.get(..words.len() * RECORD_LEN).unwrap_or_default();
        if !whole.is_empty() {
            self.flash.write(at, whole).map_err(|_| Refusal::Flash)?;
        }
        if !rest.is_empty() {
            let mut last = [0xFF; RECORD_LEN];
            for (l, r) in last.iter_mut().zip(rest) {
                *l = *r;
            }
            self.flash
                .write(at + whole.len() as u32, &last)
                .map_err(|_| Refusal::Flash)?;
        }
        incoming.written += wanted;
        self.incoming = Some(incoming);
        Ok(())
    }

    /// Judges the whole image as it stands in the flash and puts it in force.
    ///
    /// # Errors
    /// `BadLength` when pieces are missing, any reason that the content gives,
    /// `BadModel` when `accept` says no, `Flash`. The upload is over then.
    pub fn finish(
        &mut self,
        mut accept: impl FnMut(&mut F, u32, u32) -> bool,
    ) -> Result<Active, Refusal> {
        let incoming = self.incoming.take().ok_or(Refusal::BadLength)?;
        if incoming.written != incoming.image_len {
            return Err(Refusal::BadLength);
        }
        self.judge_content(incoming.slot, &incoming.header, &mut accept)?;
        let active = Active {
            slot: incoming.slot,
            header: incoming.header,
            payload: self.start(incoming.slot) + HEADER_LEN as u32,
            counter: self.active.map_or(0, |a| a.counter).saturating_add(1),
        };
        if self.append(&active, 0).is_err() {
            // A record that could not be read back now must not be found later.
            let _ = self.erase(self.records_at(incoming.slot));
            return Err(Refusal::Flash);
        }
        self.active = Some(active);
        self.restart_pending = true;
        Ok(active)
    }

    /// Gives an upload up.
    pub fn abandon(&mut self) {
        self.incoming = None;
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

    fn erase(&mut self, page: u32) -> Result<(), Refusal> {
        self.flash
            .erase(page, page + Self::PAGE)
            .map_err(|_| Refusal::Flash)
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

    fn read_header(&mut self, slot: Slot) -> Result<Header, Refusal> {
        let mut bytes = [0; HEADER_LEN.next_multiple_of(RECORD_LEN)];
        self.flash
            .read(self.start(slot), &mut bytes)
            .map_err(|_| Refusal::Flash)?;
        let header = Header::parse(&bytes)?;
        match header.image_len() {
            Some(n) if n <= self.image_capacity() => Ok(header),
            _ => Err(Refusal::TooLong),
        }
    }

    fn judge(
        &mut self,
        slot: Slot,
        header: &Header,
        accept: &mut impl FnMut(&mut F, u32, u32) -> bool,
    ) -> Result<(), Refusal> {
        header.verify(self.key.as_ref())?;
        self.judge_content(slot, header, accept)
    }

    /// Judges what stands in a slot by a header that is trusted.
    fn judge_content(
        &mut self,
        slot: Slot,
        header: &Header,
        accept: &mut impl FnMut(&mut F, u32, u32) -> bool,
    ) -> Result<(), Refusal> {
        if self.read_header(slot)? != *header {
            return Err(Refusal::BadDigest);
        }
        let start = self.start(slot);
        let payload = HEADER_LEN as u32;
        let end = payload.saturating_add(header.length);
        let mut content = Content::new(header);
        let mut crc = [0; 4];
        let mut chunk = [0; CHUNK];
        let mut at = 0;
        // Whole chunks from the start of the slot: aligned for any READ_SIZE.
        while at < end + 4 {
            self.flash
                .read(start + at, &mut chunk)
                .map_err(|_| Refusal::Flash)?;
            let head = payload.saturating_sub(at) as usize;
            content.absorb(chunk.get(head..).unwrap_or_default());
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
        content.finish(u32::from_le_bytes(crc))?;
        if accept(&mut self.flash, start + payload, header.length) {
            Ok(())
        } else {
            Err(Refusal::BadModel)
        }
    }

    /// The record that puts `header` in force under this counter.
    fn record(counter: u32, header: &Header) -> [u8; RECORD_LEN] {
        let counter = counter.to_le_bytes();
        let mut digest = CRC.digest();
        digest.update(&counter);
        digest.update(&header.signature);
        let mut record = [0; RECORD_LEN];
        let crc = digest.finalize().to_le_bytes();
        for (r, b) in record.iter_mut().zip(counter.iter().chain(&crc)) {
            *r = *b;
        }
        record
    }

    fn records(&mut self, slot: Slot, header: &Header) -> Records {
        let mut found = Records::default();
        for pair in 0..Self::PAIRS {
            let [first, second] = self.places(slot, pair).map(|at| self.read_record(at));
            for word in [first, second].into_iter().flatten() {
                let [c0, c1, c2, c3, ..] = word;
                let counter = u32::from_le_bytes([c0, c1, c2, c3]);
                if word != BLANK && word == Self::record(counter, header) {
                    found.counter = found.counter.max(Some(counter));
                    found.anchored |= Some(word) == first && second != Some(BLANK);
                }
            }
            if first != Some(BLANK) || second != Some(BLANK) {
                found.free = pair + 1;
            }
        }
        found
    }

    /// Offsets of the two records of a pair.
    fn places(&self, slot: Slot, pair: u32) -> [u32; 2] {
        let first = self.records_at(slot) + pair * 2 * RECORD_LEN as u32;
        [first, first + RECORD_LEN as u32]
    }

    /// Word by word: one unreadable word says nothing about the next.
    fn read_record(&mut self, at: u32) -> Option<[u8; RECORD_LEN]> {
        let mut word = [0; RECORD_LEN];
        self.flash.read(at, &mut word).ok().map(|()| word)
    }

    /// Makes sure that a complete record stands in the slot, and shows as such.
    fn anchor(&mut self, active: &Active) -> Result<(), Refusal> {
        let records = self.records(active.slot, &active.header);
        if records.anchored {
            Ok(())
        } else {
            self.append(active, records.free)
        }
    }

    /// Writes the first pair from `free` on that takes it.
    fn append(&mut self, active: &Active, free: u32) -> Result<(), Refusal> {
        let record = Self::record(active.counter, &active.header);
        for pair in free..Self::PAIRS {
            let [first, second] = self.places(active.slot, pair);
            if self.flash.write(first, &record).is_ok() && self.read_record(first) == Some(record) {
                // In force by now. Should the second fail, the next `anchor`
                // writes another pair.
                let _ = self.flash.write(second, &record);
                return Ok(());
            }
        }
        Err(Refusal::Flash)
    }
}
