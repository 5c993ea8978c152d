//! Injects effects into a simulated wheel bearing that its description lacks, for
//! `loadtwin simulate --effect`: changed preload, a dead or loose gauge, cage slip, strain by
//! speed. Parses name, gauge and strength.

use std::str::FromStr;

use crate::SimulateError;
use crate::simulated_bearing::plant::Individual;

/// An effect at a strength.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BearingEffect {
    /// The preload's force is multiplied by the strength.
    Preload(f64),
    /// The preload's force comes to the strength times itself as the bearing warms, within tens of seconds.
    WarmPreload(f64),
    /// Gauge of this number, from 0, answers to nothing after the strength in seconds.
    DeadGauge(usize, f64),
    /// A gauge that has come loose: its answer is multiplied by the strength.
    LooseGauge(usize, f64),
    /// Both cages lag by the strength in percent.
    CageSlip(f64),
    /// Strain in proportion to the square of the speed [um/m at 100 rad/s].
    SpeedOffset(f64),
}

/// Time in which a bearing warms [s].
const WARMING_S: f64 = 15.0;

/// Name and what strength means.
pub const BEARING_EFFECTS: [(&str, &str); 6] = [
    (
        "preload",
        "bearing: factor on the preload's force, 0.4 to 2",
    ),
    (
        "warm-preload",
        "bearing: factor that the preload's force comes to as the bearing warms, 0.4 to 2",
    ),
    (
        "dead-gauge",
        "bearing: gauge 0 to 3 by @N answers to nothing from this second on",
    ),
    (
        "loose-gauge",
        "bearing: factor on the answer of gauge 0 to 3 by @N, 0 to 1",
    ),
    (
        "cage-slip",
        "bearing: both cages lag by so many percent, 0 to 10",
    ),
    (
        "speed-offset",
        "bearing: strain by the square of the speed [um/m at 100 rad/s], -200 to 200",
    ),
];

impl FromStr for BearingEffect {
    type Err = SimulateError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (place, strength) = text.split_once('=').unwrap_or((text, ""));
        let (name, gauge) = place.split_once('@').unwrap_or((place, "0"));
        let Some((name, _)) = BEARING_EFFECTS.iter().find(|effect| effect.0 == name) else {
            return Err(SimulateError::Effect {
                found: name.into(),
                allowed: BEARING_EFFECTS.map(|effect| effect.0).join(", "),
            });
        };
        let value: f64 = strength.parse().unwrap_or(f64::NAN);
        let allowed = match *name {
            "preload" | "warm-preload" => 0.4..=2.0,
            "dead-gauge" => 0.0..=86_400.0,
            "loose-gauge" => 0.0..=1.0,
            "cage-slip" => 0.0..=10.0,
            _ => -200.0..=200.0,
        };
        if !allowed.contains(&value) {
            return Err(SimulateError::OwnStrength {
                effect: name,
                found: strength.into(),
                allowed: format!("{} to {}", allowed.start(), allowed.end()),
            });
        }
        let gauge: usize = match gauge.parse() {
            Ok(gauge) if gauge < 4 => gauge,
            _ => {
                return Err(SimulateError::Target {
                    effect: name,
                    found: gauge.into(),
                    allowed: "gauge 0 to 3".into(),
                });
            }
        };
        Ok(match *name {
            "preload" => Self::Preload(value),
            "warm-preload" => Self::WarmPreload(value),
            "dead-gauge" => Self::DeadGauge(gauge, value),
            "loose-gauge" => Self::LooseGauge(gauge, value),
            "cage-slip" => Self::CageSlip(value),
            _ => Self::SpeedOffset(value),
        })
    }
}

impl BearingEffect {
    /// Changes the bearing before the plant is made of it.
    pub(crate) fn apply(&self, individual: &mut Individual) {
        if let Self::Preload(factor) = self {
            // Force goes with the approach to the power of 3/2.
            individual.preload *= factor.powf(2.0 / 3.0);
        }
    }

    /// Factor on the preload's approach after `t` seconds.
    pub(crate) fn warming(&self, t: f64) -> f64 {
        match self {
            Self::WarmPreload(factor) => {
                (1.0 + (factor - 1.0) * (1.0 - (-t / WARMING_S).exp())).powf(2.0 / 3.0)
            }
            _ => 1.0,
        }
    }

    /// Strain that gauge number `gauge` reads at `speed` (rad/s), given the `strain` without the
    /// effect (um/m).
    pub(crate) fn read(&self, gauge: usize, t: f64, speed: f64, strain: f64) -> f64 {
        match *self {
            Self::DeadGauge(i, from) if i == gauge && t >= from => 0.0,
            Self::LooseGauge(i, factor) if i == gauge => factor * strain,
            Self::SpeedOffset(offset) => strain + offset * (speed / 100.0).powi(2),
            _ => strain,
        }
    }

    /// Part by which both cages lag.
    pub(crate) fn slip(&self) -> f64 {
        match *self {
            Self::CageSlip(percent) => 0.01 * percent,
            _ => 0.0,
        }
    }
}
