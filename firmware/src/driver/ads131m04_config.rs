//! Configuration of an ADS131M04 (`Config`): oversampling ratio and gains, from what an image wants or
//! as stated, and the values of its registers MODE, CLOCK and GAIN.
//!
//! Source: Texas Instruments, ADS131M04 data sheet (SBAS890), sections 8.5 and 8.6.

use loadtwin_common::hardware::Sampling;

use super::ads131m04::CHANNELS;

/// Oversampling ratio: conversions a second = clock input / 2 / ratio.
///
/// With 8.192 MHz at the clock input, `X2048` gives 2 kHz.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
#[expect(missing_docs, reason = "the name is the ratio")]
pub enum Oversampling {
    X128 = 0,
    X256 = 1,
    X512 = 2,
    X1024 = 3,
    X2048 = 4,
    X4096 = 5,
    X8192 = 6,
    X16384 = 7,
}

/// Gain of a channel's amplifier; full scale is 1.2 V / gain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
#[expect(missing_docs, reason = "the name is the gain")]
pub enum Gain {
    X1 = 0,
    X2 = 1,
    X4 = 2,
    X8 = 3,
    X16 = 4,
    X32 = 5,
    X64 = 6,
    X128 = 7,
}

/// How the converter is set up.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Config {
    /// Oversampling ratio of all channels.
    pub oversampling: Oversampling,
    /// Gain of each channel.
    pub gain: [Gain; CHANNELS],
}

impl Oversampling {
    /// The ratios, smallest first.
    const ALL: [Self; 8] = [
        Self::X128,
        Self::X256,
        Self::X512,
        Self::X1024,
        Self::X2048,
        Self::X4096,
        Self::X8192,
        Self::X16384,
    ];

    /// The ratio for `rate_hz` conversions a second with `clock_hz` at the clock input, within a
    /// quarter; the nearest end where it is outside all.
    fn for_rate(rate_hz: f32, clock_hz: f32) -> Self {
        let ratio = clock_hz / 2.0 / rate_hz;
        let mut smallest = 128.0 * 1.25;
        for candidate in Self::ALL {
            if ratio < smallest {
                return candidate;
            }
            smallest *= 2.0;
        }
        Self::X16384
    }
}

impl Gain {
    /// The gains, smallest first: 2 to the power of the place.
    const ALL: [Self; 8] = [
        Self::X1,
        Self::X2,
        Self::X4,
        Self::X8,
        Self::X16,
        Self::X32,
        Self::X64,
        Self::X128,
    ];
}

/// Gain of a channel for which an image states none.
const USUAL_GAIN: Gain = Gain::X32;

impl Config {
    /// The set-up for an image, with `clock_hz` at the converter's clock input.
    pub fn for_sampling(sampling: &Sampling, clock_hz: f32) -> Self {
        let mut gain = [USUAL_GAIN; CHANNELS];
        for (gain, stated) in gain.iter_mut().zip(sampling.gains) {
            let stated = stated.and_then(|power| Gain::ALL.get(usize::from(power)));
            *gain = stated.copied().unwrap_or(USUAL_GAIN);
        }
        Self {
            oversampling: Oversampling::for_rate(sampling.rate_hz, clock_hz),
            gain,
        }
    }

    /// Words of 24 bits, CRC-16/CCITT, time-out of unfinished frames on, the
    /// reset flag cleared, so that a later reset is noticed.
    pub(super) const fn mode() -> u16 {
        0x0110
    }

    /// All channels on, high-resolution mode.
    pub(super) const fn clock(self) -> u16 {
        0x0F02 | (self.oversampling as u16) << 2
    }

    pub(super) const fn gains(self) -> u16 {
        self.gain[0] as u16
            | (self.gain[1] as u16) << 4
            | (self.gain[2] as u16) << 8
            | (self.gain[3] as u16) << 12
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use loadtwin_common::hardware::NUCLEO_G474RE;
    use loadtwin_common::io::raw::MAX_CHANNELS;

    #[test]
    fn the_image_sets_rate_and_gains() {
        let mut gains = [None; MAX_CHANNELS];
        (gains[0], gains[1], gains[3]) = (Some(0), Some(7), Some(9));
        let config = |rate_hz| {
            let counter_bits = None;
            Config::for_sampling(
                &Sampling {
                    rate_hz,
                    gains,
                    counter_bits,
                },
                8.192e6,
            )
        };
        // 1, 128, the usual 32 where nothing is stated, and where nothing has that power of two.
        assert_eq!(config(2000.0).gains(), 0x5570);
        for (place, rate_hz) in NUCLEO_G474RE.rates_hz.iter().rev().enumerate() {
            // CLOCK: all channels, the code of the ratio from 256 on, high resolution.
            let clock = 0x0F02 | (place as u16 + 1) << 2;
            assert_eq!(config(*rate_hz).clock(), clock, "{rate_hz}");
            assert_eq!(config(rate_hz * 1.0009).clock(), clock, "{rate_hz}");
        }
        for outside in [1.0, 1e6, f32::NAN, -1.0] {
            let clock = config(outside).clock();
            assert!(clock == 0x0F02 || clock == 0x0F1E, "{outside}");
        }
    }
}
