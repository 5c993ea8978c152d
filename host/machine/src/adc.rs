//! Defines the description of a channel's analogue-to-digital converter (`adc`): scale, zero, word
//! length. Converts a reading to its word, and computes from the noise after how many equal words
//! in a row the channel counts as stuck.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The converter behind an analogue channel: `value = (word - zero) * lsb`.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Adc {
    /// Value of one count [the channel's unit, or mV/V of its bridge], not 0.
    pub lsb: f64,
    /// Word at value 0.
    #[serde(default)]
    pub zero: i32,
    /// Word length (bit), 8 to 32; the extreme words count as saturated.
    #[serde(default = "twenty_four")]
    pub bits: u32,
    /// After how many equal words in a row the channel counts as stuck; 0 for a channel that may
    /// rest. Where absent, as many as noise repeats once in 10^12 samples; never where the
    /// noise is too small to tell.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stuck_after: Option<u16>,
}

/// Rate at which a sound converter may repeat its word often enough to count as stuck (1/sample):
/// once in 30 years at 1 kHz.
const FALSE_STUCK: f64 = 1e-12;

/// Part of the described noise that is at least the converter's own: the remainder may be of the model.
const OWN_NOISE: f64 = 1.0 / 3.0;

/// Counts in the standard deviation of the noise where readings become words without a converter:
/// rounding then adds 1/3000 of its variance.
const COUNTS_OF_NOISE: f64 = 16.0;

impl Adc {
    /// Words for readings with noise `std`, of a channel without a converter; none counts as stuck,
    /// since a logger may round.
    pub(crate) fn of_readings(std: f64) -> Self {
        Self {
            lsb: std / COUNTS_OF_NOISE,
            zero: 0,
            bits: 32,
            stuck_after: Some(0),
        }
    }

    /// Equal words in a row after which a channel with noise `std` (words) counts as stuck; 0: never.
    ///
    /// A rounded Gaussian repeats its word with `p <= erf(1 / (2 sqrt(2) std))`: so many that
    /// `p^n` is [`FALSE_STUCK`].
    pub(crate) fn words_until_stuck(std: f64) -> u16 {
        let repeats = libm::erf(1.0 / (8.0_f64.sqrt() * OWN_NOISE * std));
        let words = (FALSE_STUCK.ln() / repeats.ln()).ceil();
        // A quiet converter repeats its word for ever: the logarithm is 0.
        if repeats < 1.0 && words <= f64::from(u16::MAX) {
            words.max(2.0) as u16
        } else {
            0
        }
    }
}

/// Quantisation of a reading in SI units: `word = round(value / lsb) + zero`, within the word length.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Quantiser {
    /// Reading of one count (SI), not 0.
    pub lsb: f64,
    /// Word at reading 0.
    pub zero: i32,
    /// Word length (bit), 8 to 32.
    pub bits: u32,
}

impl Quantiser {
    /// The word for a reading (SI).
    pub fn word(self, value: f64) -> i32 {
        let [lowest, highest] = extreme_words(self.bits).map(f64::from);
        let word = (value / self.lsb).round() + f64::from(self.zero);
        word.clamp(lowest, highest) as i32
    }
}

/// Lowest and highest word of so many `bits`, 1 to 32; both count as saturated.
pub fn extreme_words(bits: u32) -> [i32; 2] {
    let full = 1_i64 << (bits - 1);
    [-full, full - 1].map(|word| word as i32)
}

fn twenty_four() -> u32 {
    24
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_says_when_a_word_repeats_too_often() {
        // Noise of three words repeats one in 0.38 of samples, of one word in 0.87.
        assert_eq!(Adc::words_until_stuck(3.0), 29);
        assert_eq!(Adc::words_until_stuck(1.0), 193);
        assert_eq!(Adc::words_until_stuck(300.0), 6);
        // A quiet converter may repeat its word for ever.
        assert_eq!(Adc::words_until_stuck(0.1), 0);
        assert_eq!(Adc::words_until_stuck(0.0), 0);
    }
}
