//! Checks that a model image fits a board (`Hardware::serves`): sample rate, number of channels and
//! encoders, width of the counters, counted loads. Holds what the two boards of this project have.

use core::fmt;

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
    /// Sample rate (Hz); none where the board's clock follows the image.
    pub rate_hz: Option<f32>,
    /// Analogue channels.
    pub channels: usize,
    /// Encoders.
    pub encoders: usize,
    /// Width of an encoder's counter (bit); none where any width is served.
    pub counter_bits: Option<u8>,
    /// Loads whose cycles it counts; none so far.
    pub counted_loads: usize,
}

/// NUCLEO-G474RE with an ADS131M04: 8.192 MHz / 2 / 2048, four channels, TIM3 as the counter.
pub const NUCLEO_G474RE: Hardware = Hardware {
    rate_hz: Some(2000.0),
    channels: 4,
    encoders: 1,
    counter_bits: Some(16),
    counted_loads: 0,
};

/// The emulated board: its clock follows the image, and its samples come over a serial port.
pub const EMULATED: Hardware = Hardware {
    rate_hz: None,
    channels: MAX_CHANNELS,
    encoders: MAX_ENCODERS,
    counter_bits: None,
    counted_loads: 0,
};

/// Why an image does not fit a board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mismatch {
    /// The image is for another rate (Hz).
    Rate {
        /// The image's.
        found: f32,
        /// The board's.
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
                write!(f, "rate_hz: found {found}, allowed: {allowed}")
            }
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
                write!(f, "bits of the encoder: found {found}, allowed: {allowed}")
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
        if let Some(allowed) = self.rate_hz {
            let (least, most) = (
                allowed * (1.0 - RATE_TOLERANCE),
                allowed * (1.0 + RATE_TOLERANCE),
            );
            // A range holds no NaN.
            if !(least..=most).contains(&found) {
                return Err(Mismatch::Rate { found, allowed });
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
        let other = counters.iter().flatten().find(|c| c.bits != allowed);
        other.map_or(Ok(()), |counter| {
            let found = counter.bits;
            Err(Mismatch::CounterBits { found, allowed })
        })
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
