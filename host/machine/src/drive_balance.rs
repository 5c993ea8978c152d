//! Defines the description of a drive whose torque or force is recorded together with its motion
//! (`[balance]`): what a row is (motion, hold, constant speed), what is estimated (the unknown
//! load, or the drive), balance of forces, recorded signals with gain and noise, effects that
//! `loadtwin diagnose` found. Checks its fields.

use std::collections::HashSet;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::field_checks::{Checked, finite, nonzero, positive, range, within};
use loadtwin_recording::{Quantity, Unit};

/// A drive whose torque or force is recorded together with its motion.
///
/// `drive = inertia a + drag v + sum_j load_j + offset + effects + unknown`,
/// about one coordinate `x` (an angle or a travel) with `v = dx/dt`,
/// `a = dv/dt`. What the model leaves unexplained of `drive` is the error of a
/// virtual load sensor where no other load acts.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Balance {
    /// What a row of the recording is.
    #[serde(default)]
    pub regime: Regime,
    /// What the estimator estimates.
    #[serde(default)]
    pub estimate: Estimated,
    /// Unit of the drive after its gain, for reports: `N`, `Nm`, `A`.
    pub unit: Unit,
    /// The driving torque or force, or what it is proportional to (a current, a
    /// voltage): the quantity that the model explains.
    pub drive: Signal,
    /// The coordinate [rad or m after its gain]; the integral of the speed where absent.
    pub position: Option<Signal>,
    /// The speed [rad/s or m/s after its gain]; the derivative of the position where absent.
    pub speed: Option<Signal>,
    /// Temperature of what rubs [K after its gain].
    pub temperature: Option<Signal>,
    /// Measured loads that the drive works against, each in the drive's unit and
    /// sign after its gain.
    #[serde(default, rename = "load")]
    pub loads: Vec<Signal>,
    /// Drive at rest, without load [the drive's unit].
    #[serde(default)]
    pub offset: f64,
    /// Drive per acceleration [kg m^2, kg, or the drive's unit s^2/rad].
    #[serde(default)]
    pub inertia: f64,
    /// Drive per speed [N m s/rad, N s/m].
    #[serde(default)]
    pub drag: f64,
    /// Travel of one turn of the motor or screw [rad or m], > 0: the orders of a
    /// ripple are counted in it. Absent where nothing turns or its pitch is unknown.
    pub turn: Option<f64>,
    /// Rated drive [its unit], > 0, the denominator of relative errors. `loadtwin diagnose` writes
    /// the RMS of the drive where it is absent; the estimator needs it.
    pub nominal: Option<f64>,
    /// Standard deviation of what the model leaves unexplained below `tuning.cutoff_hz` [the drive's
    /// unit], > 0, a part of the estimate's. `loadtwin diagnose` writes it; where absent
    /// `tuning.parameter_std` of `nominal`.
    pub model_std: Option<f64>,
    /// Physical effects, as `loadtwin diagnose` found them.
    #[serde(default, rename = "effect")]
    pub effects: Vec<BalanceEffect>,
}

/// What the estimator estimates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Estimated {
    /// The load `unknown`, from the measured drive.
    #[default]
    Load,
    /// The drive, from the measured loads and the motion; its column is a reference, where a
    /// recording has one, and no input.
    Drive,
}

/// What a row of a recording is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Regime {
    /// A sample of a motion.
    #[default]
    Moving,
    /// A position that is held, at rest; rows have no order in time.
    Holding,
    /// A sample at constant speed; what counts of the whole recording is the
    /// mean of each signal.
    Steady,
}

/// A column of the recording and what it stands for: `gain (column - zero)`.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Signal {
    /// Column of the recording.
    pub name: String,
    /// Unit in which `gain` and `zero` understand the column; the recording may
    /// use any unit of the same quantity.
    pub unit: Unit,
    /// Quantity in SI per unit of the column, not 0.
    #[serde(default = "one")]
    pub gain: f64,
    /// Reading at zero [unit].
    #[serde(default)]
    pub zero: f64,
    /// Change of the column by one code of the converter or one count [unit], > 0. Where absent: 1
    /// of `counts`, 1e-6 rad or m of a position, 1e-6 rad/s or m/s of a speed, and 2^-20 of
    /// `nominal` of a drive or load.
    pub lsb: Option<f64>,
    /// Gain that a board sets in its converter for the column, a power of two from 1 to 128; 32 where
    /// absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub converter_gain: Option<i64>,
    /// Width of a position's counter (bit), 8 to 32.
    #[serde(default = "thirty_two")]
    pub bits: u32,
    /// Standard deviation of the column's white noise [unit], > 0. `loadtwin diagnose` writes it;
    /// where absent that of the rounding to `lsb`, of a drive 1 % of `nominal`.
    pub noise_std: Option<f64>,
}

/// An effect with its parameters.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BalanceEffect {
    /// Which effect of the library.
    pub name: String,
    /// Parameters in which the effect is not linear; meaning and unit by effect.
    #[serde(default)]
    pub shape: Vec<f64>,
    /// Drive per column of the effect [the drive's unit].
    pub coefficients: Vec<f64>,
}

impl Signal {
    /// What a value of the column stands for.
    pub fn value(&self, column: f64) -> f64 {
        self.gain * (column - self.zero)
    }
}

impl Balance {
    /// All columns that the description names.
    pub fn signals(&self) -> impl Iterator<Item = (&'static str, &Signal)> {
        [
            Some(("drive", &self.drive)),
            self.position.as_ref().map(|s| ("position", s)),
            self.speed.as_ref().map(|s| ("speed", s)),
            self.temperature.as_ref().map(|s| ("temperature", s)),
        ]
        .into_iter()
        .flatten()
        .chain(self.loads.iter().map(|s| ("load", s)))
    }

    /// Whether the position is recorded, and an angle: by its unit, or counts of
    /// what bears a torque or turns once in 2 pi.
    pub fn is_angle(&self) -> bool {
        let turns = self.unit.quantity() == Quantity::Torque
            || (self.turn).is_some_and(|turn| (turn / std::f64::consts::TAU - 1.0).abs() < 1e-3);
        match self.position.as_ref().map(|p| p.unit.quantity()) {
            Some(Quantity::Angle) => true,
            Some(Quantity::Counts) => turns,
            _ => false,
        }
    }
}

fn one() -> f64 {
    1.0
}

fn thirty_two() -> u32 {
    32
}

impl Balance {
    pub(super) fn check(&self) -> Checked {
        let mut names = HashSet::from(["t"]);
        for (key, signal) in self.signals() {
            let field = |name: &str| format!("balance.{key}.{name}");
            let fresh = names.insert(&signal.name);
            within(
                &field("name"),
                &signal.name,
                fresh && !signal.name.trim().is_empty(),
                "a name that no other column has",
            )?;
            nonzero(&field("gain"), signal.gain)?;
            finite(&field("zero"), signal.zero)?;
            range(&field("bits"), f64::from(signal.bits), 8.0, 32.0)?;
            within(
                &field("converter_gain"),
                signal.converter_gain.unwrap_or_default(),
                signal.gain_of_converter().is_ok(),
                "1, 2, 4, 8, 16, 32, 64, 128",
            )?;
            for (name, value) in [("lsb", signal.lsb), ("noise_std", signal.noise_std)] {
                value.map_or(Ok(()), |value| positive(&field(name), value))?;
            }
        }
        for (name, value) in [("nominal", self.nominal), ("model_std", self.model_std)] {
            value.map_or(Ok(()), |value| positive(&format!("balance.{name}"), value))?;
        }
        let (is, allowed) = match self.regime {
            Regime::Moving => (
                self.position.is_some() || self.speed.is_some(),
                "position or speed",
            ),
            Regime::Holding => (self.position.is_some(), "position"),
            Regime::Steady => (self.speed.is_some(), "speed"),
        };
        within("balance", "no such column", is, allowed)?;
        finite("balance.inertia", self.inertia)?;
        finite("balance.drag", self.drag)?;
        finite("balance.offset", self.offset)?;
        if let Some(turn) = self.turn {
            positive("balance.turn", turn)?;
        }
        for (i, effect) in self.effects.iter().enumerate() {
            let field = |name: &str| format!("balance.effect[{}].{name}", i + 1);
            for value in effect.shape.iter().chain(&effect.coefficients) {
                finite(&field("coefficients"), *value)?;
            }
        }
        Ok(())
    }
}
