//! Defines the analogue-to-digital converters that a description may name (`adc.converter`), their
//! full scale, word length and gains, and computes the value of one count from gain, excitation and
//! amplifier.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Word length of each of them (bit).
pub(crate) const BITS: u32 = 24;

/// Millivolts in a volt: bridges are described in mV/V.
const MILLIVOLTS_PER_VOLT: f64 = 1e3;

/// A converter known by its data sheet; words of two's complement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Converter {
    /// Texas Instruments ADS131M02 to ADS131M08: 24 bit, full scale 1.2 V / gain, gains 1 to 128 in
    /// powers of two. Source: data sheet SBAS890, section 8.3.
    Ads131m04,
    /// AVIA Semiconductor HX711: 24 bit, full scale half of its supply / gain, gains 32, 64, 128. Its
    /// supply must be the excitation. Source: data sheet, "Analog Inputs".
    Hx711,
}

/// What lies before a converter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Input {
    /// A bridge with this excitation (V), and an amplifier of this gain (V/V).
    Bridge {
        excitation_v: f64,
        amplifier_gain: f64,
    },
    /// A sensor or an amplifier with this value of a volt [unit of the channel, or mV/V of its bridge].
    PerVolt(f64),
}

impl Converter {
    /// The gains that it has.
    pub(crate) const fn gains(self) -> &'static [u16] {
        match self {
            Self::Ads131m04 => &[1, 2, 4, 8, 16, 32, 64, 128],
            Self::Hx711 => &[32, 64, 128],
        }
    }

    /// Value of one count at `gain` [unit of the channel, or mV/V of its bridge]:
    /// `full_scale / gain / 2^(bits - 1)`, in V at the input, times the value of a volt.
    ///
    /// `None` for an HX711 without excitation: its full scale follows its supply.
    pub(crate) fn lsb(self, gain: u16, input: Input) -> Option<f64> {
        let full_scale_v = match (self, input) {
            (Self::Ads131m04, _) => 1.2,
            (Self::Hx711, Input::Bridge { excitation_v, .. }) => excitation_v / 2.0,
            (Self::Hx711, Input::PerVolt(_)) => return None,
        };
        let volt = full_scale_v / f64::from(gain) / f64::from(BITS - 1).exp2();
        Some(volt * input.per_volt())
    }
}

impl Input {
    /// Value of a volt at the converter [unit of the channel, or mV/V of its bridge].
    fn per_volt(self) -> f64 {
        match self {
            Self::Bridge {
                excitation_v,
                amplifier_gain,
            } => MILLIVOLTS_PER_VOLT / excitation_v / amplifier_gain,
            Self::PerVolt(value) => value,
        }
    }
}
