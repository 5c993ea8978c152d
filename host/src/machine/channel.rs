//! Sensors: analogue channels, encoders, index pulse; and reference columns.

use std::path::PathBuf;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::recording::Unit;

/// An analogue channel.
///
/// `y = offset + m(angle) * s + noise`, where `s` is what it senses and `m` the
/// sensitivity: a constant, or a periodic map over the carrier angle (the
/// reduced strain model).
///
/// Source: Bosmans et al. 2023, eq. (1) and section 4.1.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Channel {
    /// Column of the recording and name in reports.
    pub name: String,
    /// Unit of the measured quantity; `m/m` for strain, `Nm` for torque.
    pub unit: Unit,
    /// What the channel responds to.
    pub senses: Senses,
    /// Reading at zero load [unit].
    #[serde(default)]
    pub offset: f64,
    /// Reading per unit of what it senses, the mean over the carrier angle
    /// [unit/Nm, unit/(rad/s)]; not 0.
    pub sensitivity: Option<f64>,
    /// CSV file with the sensitivity over the carrier angle: a column
    /// `carrier_angle [rad]` with equal steps over one turn from 0, and a column
    /// `NAME [unit/Nm]` for each channel that names this file.
    pub sensitivity_map: Option<PathBuf>,
    /// Standard deviation of the reading about the model [unit], > 0.
    pub noise_std: f64,
    /// CSV file with the standard deviation over bins of the carrier angle, as
    /// `sensitivity_map`; eq. (15)-(18).
    pub noise_map: Option<PathBuf>,
    /// Where the sensor sits, for tables: `torque arm`, `ring gear`, ...
    pub group: Option<Group>,
    /// The converter.
    pub adc: Adc,
}

impl Channel {
    /// A value in the channel's unit, in SI.
    pub fn to_si(&self, value: f64) -> f64 {
        self.unit.to_si(value)
    }

    /// Reading of one count [SI].
    pub fn lsb_si(&self) -> f64 {
        self.to_si(self.adc.lsb)
    }
}

/// A group of sensors that tables show together.
pub type Group = String;

/// What an analogue channel responds to.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Senses {
    /// The torque that the named shaft carries [N m].
    Shaft(String),
    /// The named load itself [N m].
    Load(String),
    /// The speed of the named inertia [rad/s].
    Speed(String),
    /// Nothing unknown: a measured torque that drives the named inertia
    /// [N m], a known input of the filter.
    Drive(String),
}

/// The converter behind an analogue channel: `value = (word - zero) * lsb`.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Adc {
    /// Value of one count [the channel's unit per count], not 0.
    pub lsb: f64,
    /// Word at value 0.
    #[serde(default)]
    pub zero: i32,
    /// Word length [bit], 8 to 32; the extreme words count as saturated.
    #[serde(default = "twenty_four")]
    pub bits: u32,
    /// After how many equal words in a row the channel counts as stuck; 0 for
    /// a channel that may rest.
    #[serde(default)]
    pub stuck_after: u16,
}

/// A counting encoder.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Encoder {
    /// Column of the recording.
    pub name: String,
    /// The inertia that it turns with.
    pub inertia: String,
    /// Counts per turn of that inertia (after quadrature), not 0; negative where it
    /// counts down in forward turning.
    pub counts_per_turn: f64,
    /// Width of the hardware counter [bit], 8 to 32.
    #[serde(default = "thirty_two")]
    pub bits: u32,
    /// Standard deviation of the measured angle [counts]; that of the
    /// quantisation, 0.29, where absent.
    pub noise_std_counts: Option<f64>,
}

/// The once-per-revolution pulse of the carrier.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Index {
    /// Column of the recording: the latched count of `encoder` in the row
    /// after the pulse, empty elsewhere.
    pub name: String,
    /// The encoder whose count the pulse latches.
    pub encoder: String,
    /// Carrier angle at the pulse [rad].
    pub angle_rad: f64,
    /// Deviation from the expected angle that counts as a fault [rad], > 0.
    #[serde(default = "index_tolerance")]
    pub tolerance_rad: f64,
}

/// A reference load in recordings.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Reference {
    /// Column of the recording.
    pub name: String,
    /// The load that it measures.
    pub load: String,
    /// Unit of the column.
    pub unit: Unit,
    /// Factor from the column to the load's sign and size.
    #[serde(default = "one")]
    pub gain: f64,
    /// Value of the column at zero load [unit].
    #[serde(default)]
    pub zero: f64,
}

/// Another recorded quantity.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Auxiliary {
    /// Column of the recording.
    pub name: String,
    /// Unit of the column.
    pub unit: Unit,
}

fn one() -> f64 {
    1.0
}

fn twenty_four() -> u32 {
    24
}

fn thirty_two() -> u32 {
    32
}

fn index_tolerance() -> f64 {
    0.05
}
