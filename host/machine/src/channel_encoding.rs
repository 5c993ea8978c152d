//! Determines from the unit of a recording's column what it holds of an analogue channel: words of
//! the converter, output of its bridge (V/V), or readings. Converts its values to readings in SI
//! units.

use crate::channel::Channel;
use loadtwin_recording::{Column, Quantity, Unit};

/// What the column of an analogue channel holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// The converter's words themselves.
    Word,
    /// The output of the channel's bridge.
    Ratio,
    /// The reading.
    Reading,
}

impl Encoding {
    /// By the unit of the column of `channel` among `columns`.
    #[must_use]
    pub fn of(channel: &Channel, columns: &[Column]) -> Self {
        let column = columns.iter().find(|column| column.name == channel.name);
        let unit = column.and_then(|column| column.unit.as_deref()?.parse::<Unit>().ok());
        match unit.map(Unit::quantity) {
            Some(Quantity::Counts) if channel.adc.is_some() => Self::Word,
            Some(Quantity::BridgeRatio) if channel.bridge.is_some() => Self::Ratio,
            _ => Self::Reading,
        }
    }

    /// The unit in which the column is read.
    #[must_use]
    pub fn unit(self, channel: &Channel) -> Unit {
        match self {
            Self::Word => Unit::COUNTS,
            Self::Ratio => Unit::VOLT_PER_VOLT,
            Self::Reading => channel.unit.si(),
        }
    }

    /// The reading of `channel` (SI) at a value of its column in [`Self::unit`]. A ratio is that of a
    /// word, as on the board; NaN stays NaN.
    #[must_use]
    pub fn reading(self, channel: &Channel, value: f64) -> f64 {
        match self {
            Self::Word => channel.reading(value),
            Self::Ratio if value.is_nan() => value,
            Self::Ratio => channel.reading(f64::from(channel.word_of_ratio(value))),
            Self::Reading => value,
        }
    }
}
