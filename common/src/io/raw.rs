//! Defines the raw sample of one tick of the sample clock (`RawSample`): converter words, encoder
//! counts and the count at the index pulse, with a validity bit for each word and encoder.

use serde::{Deserialize, Serialize};

/// Analogue channels that one sample can carry: two four-channel converters.
pub const MAX_CHANNELS: usize = 8;

/// Counting encoders that one sample can carry.
pub const MAX_ENCODERS: usize = 2;

/// One sample as the board took it: converter words and latched counters,
/// neither converted nor checked.
///
/// A channel whose bit in `valid` is 0 was not delivered (converter time-out,
/// failed CRC, empty cell of a recording); its word is not looked at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RawSample {
    /// Ticks of the sample clock since start, wrapping; a difference other
    /// than 1 to the sample before means samples were lost.
    pub tick: u32,
    /// Bit i: word i was delivered; bit 8 + k: encoder k was delivered.
    pub valid: u16,
    /// Converter words, sign-extended.
    pub words: [i32; MAX_CHANNELS],
    /// Encoder counters, as wide as the machine's image says, wrapping.
    pub encoders: [u32; MAX_ENCODERS],
    /// Counter of the index's encoder at the index pulse, where a pulse came
    /// since the sample before.
    pub index: Option<u32>,
}

impl RawSample {
    /// Whether word `channel` was delivered.
    pub fn has_word(&self, channel: usize) -> bool {
        channel < MAX_CHANNELS && self.valid & (1 << channel) != 0
    }

    /// Whether the counter of `encoder` was delivered.
    pub fn has_encoder(&self, encoder: usize) -> bool {
        encoder < MAX_ENCODERS && self.valid & (1 << (MAX_CHANNELS + encoder)) != 0
    }

    /// Marks word `channel` as delivered with value `word`.
    pub fn set_word(&mut self, channel: usize, word: i32) {
        if let Some(slot) = self.words.get_mut(channel) {
            *slot = word;
            self.valid |= 1 << channel;
        }
    }

    /// Marks the counter of `encoder` as delivered with value `count`.
    pub fn set_encoder(&mut self, encoder: usize, count: u32) {
        if let Some(slot) = self.encoders.get_mut(encoder) {
            *slot = count;
            self.valid |= 1 << (MAX_CHANNELS + encoder);
        }
    }
}
