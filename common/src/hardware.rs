//! Checks that a model image fits a board (`Hardware::serves`): sample rate, time for a sample, number
//! of channels, encoders and counted loads, width of the counters. Holds what the two boards of this
//! project have.

use core::fmt;

use crate::counting::MAX_COUNTED;
use crate::drivetrain::GearboxModel;
use crate::image::{Image, Model};
use crate::io::measurement::EncoderScaling;
use crate::io::raw::{MAX_CHANNELS, MAX_ENCODERS};

/// Largest relative deviation of an image's rate from the board's: the accuracy of a crystal and
/// its aging, with a margin of ten [1].
const RATE_TOLERANCE: f32 = 1e-3;

/// Sensors that a board reads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hardware {
    /// Sample rates that the converter has (Hz); empty where the board's clock follows the image.
    pub rates_hz: &'static [f32],
    /// Cycles of the processor in a second; none where samples may take any time.
    pub cycles_per_s: Option<f32>,
    /// Analogue channels.
    pub channels: usize,
    /// Encoders.
    pub encoders: usize,
    /// Widest counter of an encoder (bit), which counts to any width from 8 bit; none where any width
    /// is served.
    pub counter_bits: Option<u8>,
    /// Most loads whose cycles it counts.
    pub counted_loads: usize,
}

/// Narrowest counter that a description may have (bit).
const LEAST_COUNTER_BITS: u8 = 8;

/// Cycles of a Cortex-M4F in the mean of an instruction: loads, branches and the flash's wait states
/// are above 1. An estimate; instructions are counted on the emulated board.
const CYCLES_PER_INSTRUCTION: f32 = 1.5;

/// NUCLEO-G474RE with an ADS131M04: 8.192 MHz / 2 / oversampling of 256 to 16384, four channels, TIM3
/// as the counter, 170 MHz.
pub const NUCLEO_G474RE: Hardware = Hardware {
    // 32 kHz are faster than a description may be.
    rates_hz: &[250.0, 500.0, 1000.0, 2000.0, 4000.0, 8000.0, 16000.0],
    cycles_per_s: Some(170e6),
    channels: 4,
    encoders: 1,
    counter_bits: Some(16),
    counted_loads: 1,
};

/// The emulated board: its clock follows the image, and its samples come over a serial port.
pub const EMULATED: Hardware = Hardware {
    rates_hz: &[],
    cycles_per_s: None,
    channels: MAX_CHANNELS,
    encoders: MAX_ENCODERS,
    counter_bits: None,
    counted_loads: MAX_COUNTED,
};

/// Why an image does not fit a board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mismatch {
    /// The image is for another rate (Hz).
    Rate {
        /// The image's.
        found: f32,
        /// The board's.
        allowed: &'static [f32],
    },
    /// A sample takes the estimator longer than the period of the image's rate.
    Time {
        /// The image's rate (Hz).
        found: f32,
        /// The highest rate at which the estimator has the time (Hz).
        allowed: f32,
    },
    /// More analogue channels than the board has.
    Channels {
        /// The image's.
        found: usize,
        /// The board's.
        allowed: usize,
    },
    /// More encoders than the board has.
    Encoders {
        /// The image's.
        found: usize,
        /// The board's.
        allowed: usize,
    },
    /// A counter of another width (bit).
    CounterBits {
        /// The image's.
        found: u8,
        /// The board's.
        allowed: u8,
    },
    /// More loads are to be counted than the board counts.
    CountedLoads {
        /// The image's.
        found: usize,
        /// The board's.
        allowed: usize,
    },
}

impl fmt::Display for Mismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Rate { found, allowed } => {
                write!(f, "rate_hz: found {found}, allowed: one of {allowed:?}")
            }
            Self::Time { found, allowed } => write!(
                f,
                "rate_hz: found {found}, allowed: up to {allowed:.0}, at which the processor has the time for \
                 a sample of this machine"
            ),
            Self::Channels { found, allowed } => {
                write!(
                    f,
                    "analogue channels: found {found}, allowed: up to {allowed}"
                )
            }
            Self::Encoders { found, allowed } => {
                write!(f, "encoders: found {found}, allowed: up to {allowed}")
            }
            Self::CounterBits { found, allowed } => {
                write!(
                    f,
                    "bits of the encoder: found {found}, allowed: {LEAST_COUNTER_BITS} to {allowed}"
                )
            }
            Self::CountedLoads { found, allowed } => {
                write!(
                    f,
                    "[[count]]: found {found} loads, allowed: up to {allowed}"
                )
            }
        }
    }
}

impl core::error::Error for Mismatch {}

impl Hardware {
    /// Whether the board measures what `image` needs.
    ///
    /// # Errors
    /// The first thing that it does not.
    // A section of its own on the board, beside what starts a filter.
    #[inline(never)]
    pub fn serves(&self, image: &Image<'_>) -> Result<(), Mismatch> {
        let found = image.rate_hz;
        let allowed = self.rates_hz;
        if !allowed.is_empty() && self.place_of_rate(found).is_none() {
            return Err(Mismatch::Rate { found, allowed });
        }
        if let Some(cycles) = self.cycles_per_s {
            let allowed = cycles / CYCLES_PER_INSTRUCTION / instructions(&image.model);
            if found > allowed {
                return Err(Mismatch::Time { found, allowed });
            }
        }
        let (found, allowed) = (channels(&image.model), self.channels);
        if found > allowed {
            return Err(Mismatch::Channels { found, allowed });
        }
        let (found, allowed) = (image.counted.len(), self.counted_loads);
        if found > allowed {
            return Err(Mismatch::CountedLoads { found, allowed });
        }
        let counters = counters(&image.model);
        let (found, allowed) = (counters.iter().flatten().count(), self.encoders);
        if found > allowed {
            return Err(Mismatch::Encoders { found, allowed });
        }
        let Some(allowed) = self.counter_bits else {
            return Ok(());
        };
        let served = LEAST_COUNTER_BITS..=allowed;
        let other = counters
            .iter()
            .flatten()
            .find(|c| !served.contains(&c.bits));
        other.map_or(Ok(()), |counter| {
            let found = counter.bits;
            Err(Mismatch::CounterBits { found, allowed })
        })
    }

    /// Place of a rate (Hz) among those of the converter.
    pub fn place_of_rate(&self, rate_hz: f32) -> Option<usize> {
        self.rates_hz.iter().position(|allowed| {
            let tolerance = allowed * RATE_TOLERANCE;
            // A range holds no NaN.
            (allowed - tolerance..=allowed + tolerance).contains(&rate_hz)
        })
    }
}

/// How an image wants its sensors sampled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// Sample rate (Hz), > 0.
    pub rate_hz: f32,
    /// Gain of the converter for each analogue channel, as its power of two; none where the image
    /// states none.
    pub gains: [Option<u8>; MAX_CHANNELS],
    /// Width of the first encoder's counter (bit); none without encoder.
    pub counter_bits: Option<u8>,
}

impl Sampling {
    /// That of `image`.
    pub fn of(image: &Image<'_>) -> Self {
        Self {
            rate_hz: image.rate_hz,
            gains: image.gains,
            counter_bits: counters(&image.model)[0].map(|counter| counter.bits),
        }
    }
}

/// Instructions for which a sample period must have the time, for the largest model of a kind.
///
/// Source: longest samples of `--test mcu steps`, 2026-11-29: gearbox with four gauges, rotor of 20
/// states with the full recursion, drive with friction and eight orders of cogging. The end of a
/// block of the bearing, 78 900, comes once in 10 ms and may take two periods: data-ready waits.
fn instructions(model: &Model<'_>) -> f32 {
    match model {
        Model::Gearbox(_) => 7843.0,
        Model::Rotor(_) => 31_691.0,
        Model::Bearing(_) => 78_900.0 / 2.0,
        Model::Drive(_) => 3050.0,
    }
}

/// Analogue channels that a model reads.
fn channels(model: &Model<'_>) -> usize {
    match model {
        Model::Gearbox(model) => model.channels.len(),
        Model::Rotor(model) => model.channels.len(),
        Model::Bearing(model) => model.gauges.len(),
        Model::Drive(model) => model.signals().count(),
    }
}

/// Scaling of the encoders that a model reads.
fn counters(model: &Model<'_>) -> [Option<EncoderScaling>; MAX_ENCODERS] {
    let mut counters = [None; MAX_ENCODERS];
    match model {
        Model::Gearbox(GearboxModel { encoders, .. }) => {
            for (slot, encoder) in counters.iter_mut().zip(encoders) {
                *slot = Some(encoder.counter);
            }
        }
        Model::Rotor(model) => counters[0] = model.encoder.map(|encoder| encoder.counter),
        Model::Bearing(model) => counters[0] = Some(model.counter),
        Model::Drive(model) => counters[0] = model.position.map(|position| position.counter),
    }
    counters
}
