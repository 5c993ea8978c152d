//! Reads counts that a board keeps in flash: pieces with parity ([`Piece`]), and the areas that they
//! are in ([`Area`]). The board writes them; the host reads them over the bus.

mod area;
mod piece;

pub use area::{Area, Header, MessageBytes, Messages, STATE, VERSION};
pub use piece::{BLANK, CONTENT, MOST_PIECES, Piece, WORD};

/// Memory that is read in words of 8 bytes.
pub trait Words {
    /// The word at an offset; none where it cannot be read.
    fn word(&mut self, at: u32) -> Option<u64>;
}

impl Words for &[u8] {
    fn word(&mut self, at: u32) -> Option<u64> {
        let bytes = self.get(at as usize..)?.first_chunk()?;
        Some(u64::from_le_bytes(*bytes))
    }
}
