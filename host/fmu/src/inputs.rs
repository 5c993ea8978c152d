//! Holds the inputs that the environment sets on an FMU instance (readings of channels, angles of
//! encoders, index pulse), and quantises them to the raw sample that the board would have taken, as
//! `replay` does.

use loadtwin_common::io::raw::{MAX_CHANNELS, MAX_ENCODERS, RawSample};
use serde::{Deserialize, Serialize};

use crate::interface::Interface;

/// What the environment set.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Inputs {
    /// Readings of the channels (in the unit of each).
    pub readings: [f64; MAX_CHANNELS],
    /// Angles or travels of the encoders (in the unit of each).
    pub angles: [f64; MAX_ENCODERS],
    /// Whether there is a reading of each channel and encoder.
    pub delivered: ([bool; MAX_CHANNELS], [bool; MAX_ENCODERS]),
    /// Level of the index pulse; its rising edge counts.
    pub index: bool,
    /// How far the encoder has turned since the index pulse (in its unit).
    pub since_index: f64,
}

impl Default for Inputs {
    fn default() -> Self {
        Self {
            readings: [0.0; MAX_CHANNELS],
            angles: [0.0; MAX_ENCODERS],
            delivered: ([true; MAX_CHANNELS], [true; MAX_ENCODERS]),
            index: false,
            since_index: 0.0,
        }
    }
}

impl Inputs {
    /// The sample as the board would have taken it, quantised as `replay` does.
    pub(crate) fn sample(&self, interface: &Interface, tick: u32, index_was: bool) -> RawSample {
        let mut raw = RawSample {
            tick,
            ..RawSample::default()
        };
        let readings = self.readings.iter().zip(self.delivered.0);
        for (k, (channel, (reading, delivered))) in
            interface.channels.iter().zip(readings).enumerate()
        {
            if delivered {
                raw.set_word(k, channel.quantiser.word(*reading));
            }
        }
        let angles = self.angles.iter().zip(self.delivered.1);
        for (k, (encoder, (angle, delivered))) in interface.encoders.iter().zip(angles).enumerate()
        {
            if delivered {
                raw.set_encoder(k, encoder.count(*angle));
            }
        }
        if self.index && !index_was {
            raw.index = self.index_count(interface, &raw);
        }
        raw
    }

    /// The count that the index pulse latched; none where its encoder delivered none.
    fn index_count(&self, interface: &Interface, raw: &RawSample) -> Option<u32> {
        let Some(at) = interface.index.as_ref()?.encoder else {
            return Some(0);
        };
        let angle = *self.angles.get(at)? - self.since_index;
        let encoder = interface.encoders.get(at)?;
        raw.has_encoder(at).then(|| encoder.count(angle))
    }
}
