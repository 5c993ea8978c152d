//! Why a value is not to be trusted.

use serde::{Deserialize, Serialize};

/// What is wrong with a channel, an encoder or a load in one sample.
///
/// The discriminants are the failure mode identifiers (FMI) of SAE J1939-73
/// where one fits; they travel on the bus.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[repr(u8)]
pub enum Fault {
    /// Nothing is wrong (FMI 31, "condition exists", is never sent for it).
    #[default]
    None = 31,
    /// The normalised innovation squared is over the gate: the reading
    /// contradicts the model and the other channels (FMI 2, data erratic).
    Erratic = 2,
    /// The word is at the upper end of the converter (FMI 3, voltage above
    /// normal; an open bridge drives it there).
    SaturatedHigh = 3,
    /// The word is at the lower end of the converter (FMI 4, voltage below normal).
    SaturatedLow = 4,
    /// The word has not changed for as long as the image allows (FMI 7, not
    /// responding properly).
    Stuck = 7,
    /// The sample carried no valid word (FMI 9, abnormal update rate).
    Missing = 9,
    /// The estimate has not settled, or has been without a usable sensor for
    /// too long (FMI 11, root cause not known).
    NotValid = 11,
    /// The carrier angle is not homed yet (FMI 13, out of calibration).
    NotHomed = 13,
    /// The encoder jumped or the index pulse came at a wrong angle (FMI 10,
    /// abnormal rate of change).
    Slipped = 10,
}

impl Fault {
    /// Every kind, for tables and counters.
    pub const ALL: [Self; 9] = [
        Self::None,
        Self::Erratic,
        Self::SaturatedHigh,
        Self::SaturatedLow,
        Self::Stuck,
        Self::Missing,
        Self::NotValid,
        Self::NotHomed,
        Self::Slipped,
    ];

    /// The name in JSON, CSV and logs.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Erratic => "erratic",
            Self::SaturatedHigh => "saturated_high",
            Self::SaturatedLow => "saturated_low",
            Self::Stuck => "stuck",
            Self::Missing => "missing",
            Self::NotValid => "not_valid",
            Self::NotHomed => "not_homed",
            Self::Slipped => "slipped",
        }
    }

    /// The kind with this identifier on the bus.
    pub fn from_code(code: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|fault| *fault as u32 == code)
    }

    /// Whether the value is free of faults.
    pub fn is_none(self) -> bool {
        self == Self::None
    }
}
