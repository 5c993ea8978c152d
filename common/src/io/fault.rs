//! Lists the faults of sensors and loads (`Fault`) with their codes on the bus, their names and
//! their likely causes. The codes are the failure mode identifiers of SAE J1939-73 where one fits.

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
    /// The word has not changed for as long as the image allows, the count stands still while the
    /// model turns, or a bearing's gauge shows no ball-passing strain (FMI 7, not responding
    /// properly).
    Stuck = 7,
    /// The sample carried no valid word (FMI 9, abnormal update rate).
    Missing = 9,
    /// The estimate has not settled, or has been without a usable sensor for
    /// too long (FMI 11, root cause not known).
    NotValid = 11,
    /// The carrier angle is not homed yet (FMI 13, out of calibration).
    NotHomed = 13,
    /// The encoder jumped, the index pulse came at a wrong angle or not at all, or the cage of a
    /// bearing slips by more than its limit (FMI 10, abnormal rate of change).
    Slipped = 10,
    /// The reading does not respond to the load: its mean square is that of noise around
    /// a constant (FMI 5, current below normal or open circuit).
    Dead = 5,
    /// A load beyond its full scale, or a speed or its change that the loads and inertias of the
    /// machine cannot make, such as an encoder aliased by whole turns a sample (FMI 8, abnormal
    /// frequency).
    Implausible = 8,
    /// The reading is the expected one times a constant (FMI 12, bad device).
    Gain = 12,
    /// The reading is minus the expected one (FMI 14, special instructions: exchange the wires).
    Reversed = 14,
    /// Two readings are each other's (FMI 19, received data in error).
    Swapped = 19,
    /// The reading is the expected one plus a constant (FMI 20, data drifted).
    Offset = 20,
    /// The reading is the expected one plus what grows with time (FMI 21, data drifted).
    Drift = 21,
    /// The sensors contradict each other and none is isolated as the cause (no FMI).
    Contradicted = 22,
}

impl Fault {
    /// Every kind, for tables and counters.
    pub const ALL: [Self; 17] = [
        Self::None,
        Self::Erratic,
        Self::SaturatedHigh,
        Self::SaturatedLow,
        Self::Stuck,
        Self::Missing,
        Self::NotValid,
        Self::NotHomed,
        Self::Slipped,
        Self::Dead,
        Self::Implausible,
        Self::Gain,
        Self::Reversed,
        Self::Swapped,
        Self::Offset,
        Self::Drift,
        Self::Contradicted,
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
            Self::Dead => "dead",
            Self::Implausible => "implausible",
            Self::Gain => "gain",
            Self::Reversed => "reversed",
            Self::Swapped => "swapped",
            Self::Offset => "offset",
            Self::Drift => "drift",
            Self::Contradicted => "contradicted",
        }
    }

    /// The likely cause, for messages; empty for [`Fault::None`].
    pub fn cause(self) -> &'static str {
        match self {
            Self::None => "",
            Self::Erratic => "noise, a loose contact, or a description that is wrong",
            Self::SaturatedHigh => "an open bridge, or a range that is too small",
            Self::SaturatedLow => "a short circuit, or a range that is too small",
            Self::Stuck => "a converter or counter that hangs",
            Self::Missing => "a converter, link or logger that delivers nothing",
            Self::NotValid => "start, a long gap, or too few usable sensors",
            Self::NotHomed => "no index pulse since start",
            Self::Slipped => "lost counts, a slipping encoder, or a false index pulse",
            Self::Dead => "a gauge that came loose, or a broken wire behind the bridge",
            Self::Implausible => "counts at random, or a speed above what the counter resolves",
            Self::Gain => "a partly loose gauge, another gauge factor, or a wrong bridge supply",
            Self::Reversed => "exchanged wires of the bridge",
            Self::Swapped => "exchanged connectors or columns",
            Self::Offset => "a zero that was taken under load, or an overloaded gauge",
            Self::Drift => "temperature, moisture, or an adhesive that creeps",
            Self::Contradicted => "a faulty sensor among too few to isolate it",
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
