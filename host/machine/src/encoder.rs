//! Defines the description of counting encoders (`[[encoder]]`) and of the index pulse (`[index]`),
//! and checks their fields. Computes the value of the hardware counter at an angle, and the angle
//! error of an eccentric encoder disc.

use std::f64::consts::TAU;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::field_checks::{Checked, finite, nonzero, positive, within};
use loadtwin_recording::Role;

/// Standard deviation of a count that is rounded, `1 / sqrt 12` (counts).
pub const QUANTISATION: f64 = 0.288_675_134_594_812_9;

/// A counting encoder.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Encoder {
    /// Column of the recording.
    pub name: String,
    /// The inertia that it turns with; absent on a rotor.
    #[serde(default)]
    pub inertia: String,
    /// Counts per turn of that inertia (after quadrature), not 0; negative where it
    /// counts down in forward turning.
    pub counts_per_turn: f64,
    /// Width of the hardware counter (bit), 8 to 32.
    #[serde(default = "thirty_two")]
    pub bits: u32,
    /// Standard deviation of the measured angle (counts); that of the
    /// quantisation, 0.29, where absent.
    pub noise_std_counts: Option<f64>,
    /// How it errs once per turn, of the index's encoder where that turns as the index does.
    pub eccentricity: Option<Eccentricity>,
}

/// Error of an encoder whose disc is not centred: it reads `amplitude cos(angle - ahead_at)`
/// ahead at an angle.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Eccentricity {
    /// Largest error (rad), above 0, up to 0.1.
    pub amplitude_rad: f64,
    /// Angle at which it reads furthest ahead (rad).
    pub ahead_at_rad: f64,
}

/// Hardware counter of an encoder, which wraps.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Counter {
    /// Counts per turn, not 0.
    pub counts_per_turn: f64,
    /// Its width (bit), 8 to 32.
    pub bits: u32,
}

impl Counter {
    /// Its value for a count.
    pub fn at_count(self, count: f64) -> u32 {
        (count.round() as i64).rem_euclid(1_i64 << self.bits) as u32
    }

    /// Its value at an angle (rad) or travel (m), one turn of which is 2 pi.
    pub fn at_angle(self, angle: f64) -> u32 {
        self.at_count(angle / TAU * self.counts_per_turn)
    }
}

impl Encoder {
    /// The hardware counter.
    pub fn counter(&self) -> Counter {
        Counter {
            counts_per_turn: self.counts_per_turn,
            bits: self.bits,
        }
    }

    /// Standard deviation of the measured angle (counts).
    pub fn noise_std_counts(&self) -> f64 {
        self.noise_std_counts.unwrap_or(QUANTISATION)
    }

    /// What its column is where rows are brought onto other ticks; `is_angle`: it holds an angle
    /// in place of counts.
    pub fn role(&self, is_angle: bool) -> Role {
        Role::Counts {
            modulus: (!is_angle).then(|| f64::from(self.bits).exp2()),
        }
    }

    /// Checks what is described but the inertia; `as_index`: whether the index latches it and turns
    /// with it.
    pub(super) fn check(&self, field: impl Fn(&str) -> String, as_index: bool) -> Checked {
        nonzero(&field("counts_per_turn"), self.counts_per_turn)?;
        let bits = self.bits;
        within(&field("bits"), bits, (8..=32).contains(&bits), "8 to 32")?;
        if let Some(noise) = self.noise_std_counts {
            positive(&field("noise_std_counts"), noise)?;
        }
        let Some(eccentricity) = self.eccentricity else {
            return Ok(());
        };
        within(
            &field("eccentricity"),
            &self.name,
            as_index,
            "of the encoder that index.encoder names, on an inertia of a drivetrain with speed_ratio 1",
        )?;
        let amplitude = eccentricity.amplitude_rad;
        within(
            &field("eccentricity.amplitude_rad"),
            amplitude,
            amplitude > 0.0 && amplitude <= 0.1,
            "above 0, up to 0.1",
        )?;
        finite(
            &field("eccentricity.ahead_at_rad"),
            eccentricity.ahead_at_rad,
        )
    }
}

impl Index {
    /// Checks what is described but the encoder.
    pub(super) fn check(&self) -> Checked {
        finite("index.angle_rad", self.angle_rad)?;
        positive("index.tolerance_rad", self.tolerance_rad)
    }
}

impl Eccentricity {
    /// From its parts with the cosine and the sine of the angle (rad).
    pub fn from_parts([cosine, sine]: [f64; 2]) -> Self {
        Self {
            amplitude_rad: cosine.hypot(sine),
            ahead_at_rad: sine.atan2(cosine),
        }
    }

    /// Its parts with the cosine and the sine of the angle past `zero` (rad).
    pub fn parts_from(self, zero: f64) -> [f64; 2] {
        let (sine, cosine) = (self.ahead_at_rad - zero).sin_cos();
        [self.amplitude_rad * cosine, self.amplitude_rad * sine]
    }

    /// How far ahead it reads at an angle (rad).
    pub fn error(self, angle: f64) -> f64 {
        self.amplitude_rad * (angle - self.ahead_at_rad).cos()
    }
}

/// The once-per-revolution pulse of the carrier.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Index {
    /// Column of the recording: counts of `encoder` latched by the pulse, or the
    /// pulse itself as a level (0 and 1, a Boolean, a voltage). A pulse comes with
    /// a new count, or with the edge that begins it.
    pub name: String,
    /// The encoder whose count the pulse latches; absent on a machine without
    /// counting encoders, whose column then holds a level.
    #[serde(default)]
    pub encoder: String,
    /// What the column holds; found from its values where absent.
    pub signal: Option<IndexSignal>,
    /// Carrier angle at the pulse (rad).
    pub angle_rad: f64,
    /// Deviation from the expected angle that counts as a fault (rad), > 0.
    #[serde(default = "index_tolerance")]
    pub tolerance_rad: f64,
}

/// What the column of an index pulse holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum IndexSignal {
    /// Latched counts: each new value is a pulse; empty, 0 or the same count elsewhere.
    Latched,
    /// A level of any width and height: its rising edge is the pulse.
    Level,
    /// A level that is low during the pulse: its falling edge is the pulse.
    ActiveLow,
}

fn thirty_two() -> u32 {
    32
}

fn index_tolerance() -> f64 {
    0.05
}
