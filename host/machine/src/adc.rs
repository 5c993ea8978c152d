//! Defines the description of a channel's analogue-to-digital converter (`adc`): scale, zero, word
//! length, gain. Converts a reading to its word, and computes from the noise after how many equal words
//! in a row the channel counts as stuck.

use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};

use crate::converter::{self, Converter, Input};

/// The converter behind an analogue channel: `value = (word - zero) * lsb`.
///
/// In a description it is written as [`AdcFields`].
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(try_from = "AdcFields")]
pub struct Adc {
    /// Value of one count [the channel's unit, or mV/V of its bridge], not 0.
    pub lsb: f64,
    /// Word at value 0.
    pub zero: i32,
    /// Word length (bit), 8 to 32; the extreme words count as saturated.
    pub bits: u32,
    /// After how many equal words in a row the channel counts as stuck; see [`AdcFields`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stuck_after: Option<u16>,
    /// Gain that a board sets in its converter for this channel, a power of two; none where the
    /// description states none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gain: Option<u16>,
    /// The converter, where the description names it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub converter: Option<Converter>,
    /// Excitation of the bridge (V), where the description states it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub excitation_v: Option<f64>,
}

/// The table `adc` of a description: one count as `lsb`, or the converter with its gain and what
/// lies before it.
#[derive(Clone, Copy, Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Adc")]
pub struct AdcFields {
    /// Value of one count [the channel's unit, or mV/V of its bridge], not 0; computed from
    /// `converter` where absent.
    lsb: Option<f64>,
    /// The converter, in place of `lsb`: with `gain`, and `excitation_v` or `per_volt`.
    converter: Option<Converter>,
    /// Gain of the converter's own amplifier, a power of two from 1 to 128; a board sets it.
    /// Where absent a board takes 32.
    #[schemars(range(min = 1, max = 128))]
    gain: Option<i64>,
    /// Excitation of the bridge (V), > 0.
    excitation_v: Option<f64>,
    /// Gain of an amplifier between bridge and converter (V/V), > 0; 1 where absent.
    amplifier_gain: Option<f64>,
    /// Value of one volt at the converter's input [the channel's unit, or mV/V of its bridge], not 0:
    /// of a sensor or an amplifier with an output in volts. An amplifier of 10 V at 2 mV/V has 0.2.
    per_volt: Option<f64>,
    /// Word at value 0.
    #[serde(default)]
    zero: i32,
    /// Word length (bit), 8 to 32, 24 where absent; the extreme words count as saturated.
    bits: Option<u32>,
    /// After how many equal words in a row the channel counts as stuck; 0 for a channel that may
    /// rest. Where absent, as many as noise repeats once in 10^12 samples; never where the
    /// noise is too small to tell.
    stuck_after: Option<u16>,
}

/// Word length where the description names neither it nor a converter (bit).
const BITS: u32 = 24;

/// Largest gain of a converter that a board sets.
const MOST_GAIN: u16 = 128;

/// Excitations of a strain-gauge bridge (V): above lies what heats its gauges.
const LEAST_EXCITATION_V: f64 = 0.1;
const MOST_EXCITATION_V: f64 = 30.0;

/// A gain that a board can set: a power of two.
pub(crate) fn checked_gain(found: i64) -> Result<u16, String> {
    let gain = u16::try_from(found).ok();
    gain.filter(|gain| gain.is_power_of_two() && *gain <= MOST_GAIN)
        .ok_or_else(|| format!("gain: found {found}, allowed: 1, 2, 4, 8, 16, 32, 64, 128"))
}

impl JsonSchema for Adc {
    fn schema_name() -> Cow<'static, str> {
        AdcFields::schema_name()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        AdcFields::json_schema(generator)
    }
}

impl TryFrom<AdcFields> for Adc {
    type Error = String;

    fn try_from(fields: AdcFields) -> Result<Self, String> {
        let gain = fields.gain.map(checked_gain).transpose()?;
        let lsb = match (fields.lsb, fields.converter) {
            (Some(lsb), None) => fields.without_converter(lsb)?,
            (None, Some(converter)) => fields.of_converter(converter, gain)?,
            (None, None) => {
                return Err(
                    "adc: found neither `lsb` nor `converter`, allowed: one of them".into(),
                );
            }
            (Some(_), Some(_)) => {
                return Err("adc: found `lsb` and `converter`, allowed: one of them".into());
            }
        };
        Ok(Self {
            lsb,
            zero: fields.zero,
            bits: fields.bits.unwrap_or(BITS),
            stuck_after: fields.stuck_after,
            gain,
            converter: fields.converter,
            excitation_v: fields.excitation_v,
        })
    }
}

impl AdcFields {
    /// The count as given, beside which nothing else makes one.
    fn without_converter(&self, lsb: f64) -> Result<f64, String> {
        let beside = [
            ("excitation_v", self.excitation_v),
            ("amplifier_gain", self.amplifier_gain),
            ("per_volt", self.per_volt),
        ];
        match beside.iter().find(|(_, value)| value.is_some()) {
            Some((name, _)) => Err(format!(
                "{name}: found beside `lsb`, allowed: with `converter` in place of `lsb`"
            )),
            None => Ok(lsb),
        }
    }

    /// One count of `converter`.
    fn of_converter(&self, converter: Converter, gain: Option<u16>) -> Result<f64, String> {
        let gains = converter.gains();
        let Some(gain) = gain.filter(|gain| gains.contains(gain)) else {
            let found = self.gain.map_or("nothing".into(), |gain| gain.to_string());
            return Err(format!("gain: found {found}, allowed: one of {gains:?}"));
        };
        if let Some(bits) = self.bits.filter(|bits| *bits != converter::BITS) {
            let allowed = converter::BITS;
            return Err(format!("bits: found {bits}, allowed: {allowed}"));
        }
        let amplifier_gain = self.amplifier_gain.unwrap_or(1.0);
        let input = match (self.excitation_v, self.per_volt) {
            (Some(excitation_v), None) => {
                if !(LEAST_EXCITATION_V..=MOST_EXCITATION_V).contains(&excitation_v) {
                    return Err(format!(
                        "excitation_v: found {excitation_v}, allowed: {LEAST_EXCITATION_V} to {MOST_EXCITATION_V} V"
                    ));
                }
                positive("amplifier_gain", amplifier_gain)?;
                Input::Bridge {
                    excitation_v,
                    amplifier_gain,
                }
            }
            (None, Some(_)) if converter == Converter::Hx711 => {
                return Err(
                    "per_volt: found with hx711, allowed: excitation_v, the supply of bridge and converter (V)".into(),
                );
            }
            (None, Some(value)) if self.amplifier_gain.is_none() => {
                if !(value.is_finite() && value != 0.0) {
                    return Err(format!("per_volt: found {value}, allowed: a number, not 0"));
                }
                Input::PerVolt(value)
            }
            (None, Some(_)) => {
                return Err(
                    "amplifier_gain: found beside `per_volt`, allowed: in `per_volt`".into(),
                );
            }
            _ => {
                return Err(
                    "adc: allowed beside `converter`: `excitation_v` of a bridge, or `per_volt`"
                        .into(),
                );
            }
        };
        converter.lsb(gain, input).ok_or_else(|| {
            "excitation_v: found nothing, allowed: the supply of the HX711 (V)".into()
        })
    }
}

fn positive(name: &str, value: f64) -> Result<(), String> {
    if value > 0.0 && value.is_finite() {
        Ok(())
    } else {
        Err(format!("{name}: found {value}, allowed: above 0"))
    }
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
            gain: None,
            converter: None,
            excitation_v: None,
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

    fn read(text: &str) -> Result<Adc, String> {
        toml::from_str(text).map_err(|error: toml::de::Error| error.message().to_owned())
    }

    #[test]
    fn a_converter_gives_its_count() {
        // 1200 mV / 32 / 2^23 / 2.5 V.
        let adc = read("converter = \"ads131m04\"\ngain = 32\nexcitation_v = 2.5").unwrap();
        assert!((adc.lsb / 1.788_139_343e-6 - 1.0).abs() < 1e-9);
        assert_eq!((adc.bits, adc.gain), (24, Some(32)));
        // 20 mV of full scale at 5 V and gain 128, of 5 V: 4 mV/V.
        let adc = read("converter = \"hx711\"\ngain = 128\nexcitation_v = 5").unwrap();
        assert!((adc.lsb * 8_388_608.0 / 3.906_25 - 1.0).abs() < 1e-12);
        // An amplifier of 10 V at 2 mV/V: full scale 1.2 V is 0.24 mV/V.
        let adc = read("converter = \"ads131m04\"\ngain = 1\nper_volt = 0.2").unwrap();
        assert!((adc.lsb * 8_388_608.0 / 0.24 - 1.0).abs() < 1e-12);
        let adc =
            read("converter = \"ads131m04\"\ngain = 1\nexcitation_v = 5\namplifier_gain = 100");
        assert!((adc.unwrap().lsb * 8_388_608.0 / 2.4 - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_converter_that_is_not_told_whole_is_refused() {
        for (text, says) in [
            ("", "neither `lsb` nor `converter`"),
            ("lsb = 1.0\nconverter = \"hx711\"", "`lsb` and `converter`"),
            (
                "lsb = 1.0\nexcitation_v = 5",
                "excitation_v: found beside `lsb`",
            ),
            ("lsb = 1.0\ngain = 3", "gain: found 3"),
            ("lsb = 1.0\ngain = -1", "gain: found -1"),
            (
                "converter = \"ads131m04\"\ngain = 1\nper_volt = 0",
                "per_volt: found 0",
            ),
            (
                "converter = \"ads131m04\"\ngain = 1\nexcitation_v = 2500",
                "0.1 to 30 V",
            ),
            (
                "converter = \"ads131m04\"\nexcitation_v = 5",
                "gain: found nothing",
            ),
            (
                "converter = \"hx711\"\ngain = 16\nexcitation_v = 5",
                "gain: found 16",
            ),
            (
                "converter = \"hx711\"\ngain = 64\nper_volt = 1",
                "per_volt: found with hx711",
            ),
            (
                "converter = \"ads131m04\"\ngain = 1",
                "`excitation_v` of a bridge, or `per_volt`",
            ),
            (
                "converter = \"ads131m04\"\ngain = 1\nexcitation_v = 0",
                "excitation_v: found 0",
            ),
            (
                "converter = \"ads131m04\"\ngain = 1\nexcitation_v = 5\nbits = 16",
                "bits: found 16",
            ),
        ] {
            let refused = read(text).unwrap_err();
            assert!(refused.contains(says), "{text}: {refused}");
        }
    }
}
