//! Encodes and decodes the pieces that kept counts consist of in flash: a head with a CRC, up to 240
//! bytes, and a parity word, by which any one damaged word of 8 bytes is restored.
//!
//! | word | content |
//! |---|---|
//! | head | length, index in the message (bit 7: the last one), message (16 bits), CRC-32 |
//! | 1 to 30 | content, filled up with 0xFF |
//! | parity | exclusive or of all words before it |
//!
//! Little endian. The CRC is over the generation of the area, what precedes the CRC in the head, and
//! the content: a piece that an erase left behind is none of the next generation.

use super::Words;
use crate::io::signed_image::CRC;

/// Bytes of a word, which is programmed at once.
pub const WORD: usize = 8;

/// Most words of content.
const MOST_WORDS: usize = 30;

/// Most bytes of content.
pub const CONTENT: usize = MOST_WORDS * WORD;

/// Bit of the index that marks the last piece of a message.
const LAST: u8 = 0x80;

/// Most pieces of a message.
pub const MOST_PIECES: usize = LAST as usize;

/// A word after an erase.
pub const BLANK: u64 = u64::MAX;

/// A piece of a message.
#[derive(Clone, Debug)]
pub struct Piece {
    /// Number of the message in its area.
    pub message: u16,
    /// Number of the piece in its message.
    pub index: u8,
    /// Whether it is the last one of its message.
    pub is_last: bool,
    length: u8,
    /// Head, content and parity.
    words: [u64; MOST_WORDS + 2],
}

impl Piece {
    /// A piece with the first [`CONTENT`] bytes of `content`, at least one.
    pub fn new(generation: u32, message: u16, index: u8, is_last: bool, content: &[u8]) -> Self {
        let content = content.get(..CONTENT).unwrap_or(content);
        let mut words = [BLANK; MOST_WORDS + 2];
        let (_, places) = words.split_at_mut(1);
        for (word, bytes) in places.iter_mut().zip(content.chunks(WORD)) {
            let mut whole = [0xFF; WORD];
            for (to, from) in whole.iter_mut().zip(bytes) {
                *to = *from;
            }
            *word = u64::from_le_bytes(whole);
        }
        let mut piece = Self {
            message,
            index,
            is_last,
            length: content.len() as u8,
            words,
        };
        let crc = piece.crc(generation);
        let [low, high] = message.to_le_bytes();
        let [c0, c1, c2, c3] = crc.to_le_bytes();
        let index = piece.index_byte();
        let head = [piece.length, index, low, high, c0, c1, c2, c3];
        piece.set(0, u64::from_le_bytes(head));
        let content_words = piece.content_words();
        let parity = (piece.words.iter().take(content_words + 1)).fold(0, |sum, word| sum ^ word);
        piece.set(content_words + 1, parity);
        piece
    }

    fn index_byte(&self) -> u8 {
        self.index & !LAST | if self.is_last { LAST } else { 0 }
    }

    fn set(&mut self, place: usize, word: u64) {
        if let Some(slot) = self.words.get_mut(place) {
            *slot = word;
        }
    }

    fn content_words(&self) -> usize {
        usize::from(self.length).div_ceil(WORD)
    }

    /// Bytes in flash.
    pub fn size(&self) -> u32 {
        ((self.content_words() + 2) * WORD) as u32
    }

    /// A byte of the content; none at its end.
    pub fn byte(&self, place: usize) -> Option<u8> {
        let word = self.words.get(1 + place / WORD)?;
        (place < usize::from(self.length)).then(|| word.to_le_bytes()[place % WORD])
    }

    fn crc(&self, generation: u32) -> u32 {
        let mut digest = CRC.digest();
        digest.update(&generation.to_le_bytes());
        digest.update(&[self.length, self.index_byte()]);
        digest.update(&self.message.to_le_bytes());
        let mut rest = usize::from(self.length);
        for word in self.words.iter().skip(1).take(self.content_words()) {
            let bytes = word.to_le_bytes();
            digest.update(bytes.get(..rest).unwrap_or(&bytes));
            rest = rest.saturating_sub(WORD);
        }
        digest.finalize()
    }

    /// The piece whose words these are, by the head among them.
    fn parse(generation: u32, words: &[u64; MOST_WORDS + 2], head: u64) -> Option<Self> {
        let [length, index, low, high, crc @ ..] = head.to_le_bytes();
        let mut piece = Self {
            message: u16::from_le_bytes([low, high]),
            index: index & !LAST,
            is_last: index & LAST != 0,
            length,
            words: *words,
        };
        piece.set(0, head);
        let is = (1..=CONTENT).contains(&usize::from(length))
            && piece.crc(generation) == u32::from_le_bytes(crc);
        is.then_some(piece)
    }

    /// Reads the piece at `at`, below `end`; one damaged word is restored.
    pub fn read(flash: &mut impl Words, at: u32, end: u32, generation: u32) -> Option<Self> {
        let head = read_word(flash, at, end);
        if head == Some(BLANK) {
            return None;
        }
        let mut words = [BLANK; MOST_WORDS + 2];
        let mut lost = [false; MOST_WORDS + 2];
        for (place, (word, lost)) in words.iter_mut().zip(&mut lost).enumerate() {
            let found = if place == 0 {
                head
            } else {
                read_word(flash, at + (place * WORD) as u32, end)
            };
            *lost = found.is_none();
            *word = found.unwrap_or(BLANK);
        }
        let whole = head.and_then(|head| by_head(generation, &words, &lost, head));
        whole.or_else(|| without_head(generation, &words, &lost))
    }

    /// Its words in their order.
    pub fn words(&self) -> &[u64] {
        let words = self.words.get(..self.content_words() + 2);
        words.unwrap_or(&self.words)
    }
}

/// The piece whose head was read; a word of its content may be damaged.
fn by_head(
    generation: u32,
    words: &[u64; MOST_WORDS + 2],
    lost: &[bool; MOST_WORDS + 2],
    head: u64,
) -> Option<Piece> {
    let [length, ..] = head.to_le_bytes();
    if !(1..=CONTENT).contains(&usize::from(length)) {
        return None;
    }
    let parity = usize::from(length).div_ceil(WORD) + 1;
    let gone = lost.iter().take(parity).filter(|lost| **lost).count();
    if gone == 0
        && let Some(piece) = Piece::parse(generation, words, head)
    {
        return Some(piece);
    }
    let sum = words
        .iter()
        .take(parity + 1)
        .fold(0, |sum, word| sum ^ word);
    if gone > 1 || sum == 0 || lost.get(parity) == Some(&true) {
        return None;
    }
    (1..parity).find_map(|place| {
        if gone == 1 && lost.get(place) != Some(&true) {
            return None;
        }
        let mut restored = *words;
        *restored.get_mut(place)? ^= sum;
        Piece::parse(generation, &restored, head)
    })
}

/// The piece whose head is damaged: of every length, the one that fits its head.
fn without_head(
    generation: u32,
    words: &[u64; MOST_WORDS + 2],
    lost: &[bool; MOST_WORDS + 2],
) -> Option<Piece> {
    let mut sum = 0;
    for ((parity, word), is_lost) in words.iter().enumerate().zip(lost).skip(1) {
        if *is_lost {
            return None;
        }
        sum ^= word;
        let [length, ..] = sum.to_le_bytes();
        if parity > 1
            && usize::from(length).div_ceil(WORD) + 1 == parity
            && let Some(piece) = Piece::parse(generation, words, sum)
        {
            return Some(piece);
        }
    }
    None
}

/// A word below `end`; none where it cannot be read.
fn read_word(flash: &mut impl Words, at: u32, end: u32) -> Option<u64> {
    if at.checked_add(WORD as u32)? > end {
        return None;
    }
    flash.word(at)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every damage of one word, in every place, is restored; of two words, none is.
    #[test]
    fn any_one_damaged_word_is_restored() {
        let content: [u8; 80] = core::array::from_fn(|i| (i * 37) as u8);
        let piece = Piece::new(7, 300, 5, true, &content);
        let mut flash = [0xFF_u8; 256];
        for (bytes, word) in flash.chunks_mut(WORD).zip(piece.words()) {
            bytes.copy_from_slice(&word.to_le_bytes());
        }
        let read = |flash: &[u8], generation| Piece::read(&mut &*flash, 0, 256, generation);
        assert!(read(&flash, 7).is_some() && read(&flash, 8).is_none());
        let places = piece.words().len();
        assert_eq!(places, 12);
        for place in 0..places {
            for damage in [1_u8, 0x80, 0xFF] {
                let mut damaged = flash;
                damaged[place * WORD + 3] ^= damage;
                let found = read(&damaged, 7).expect("it is restored");
                assert_eq!((found.message, found.index, found.is_last), (300, 5, true));
                for (k, byte) in content.iter().enumerate() {
                    assert_eq!(found.byte(k), Some(*byte), "{place}");
                }
                assert_eq!(found.byte(content.len()), None);
                damaged[(place + 1) % places * WORD + 6] ^= damage;
                assert!(read(&damaged, 7).is_none(), "{place}");
            }
        }
    }
}
