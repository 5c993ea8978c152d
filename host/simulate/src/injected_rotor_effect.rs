//! Injects effects into a simulated rotor that its description lacks, for
//! `loadtwin simulate --effect`: sensor bias, runout, gain error, shaft bow, misalignment, a softer
//! bearing. Parses name, target and strength, and changes plant, forces and readings.

use std::f64::consts::TAU;
use std::str::FromStr;

use rand::RngExt;

use crate::error::SimulateError;
use crate::rng::Draw;
use crate::rotor_plant::Pull;
use loadtwin_machine::{Channel, Machine, Rotor, RotorBearing, Senses};

/// Name of each effect, and what a strength of 1 means.
pub const ROTOR_EFFECTS: [(&str, &str); 6] = [
    (
        "sensor-bias",
        "rotor: the reading of one channel is off by 10 µm, and settles a little",
    ),
    (
        "runout",
        "rotor: the surface at one node with sensors is 10 µm out of true",
    ),
    (
        "gain-error",
        "rotor: one channel reads 5 % more, and less where it reads much",
    ),
    (
        "shaft-bow",
        "rotor: the shaft is bent by 20 µm in the middle between its bearings",
    ),
    (
        "misalignment",
        "rotor: a coupling pulls an end of the shaft twice a turn, 5 % of a nominal load",
    ),
    (
        "bearing-stiffness",
        "rotor: one bearing is softer, by 30 % along x and 24 % along y",
    ),
];

/// Size of a bias and of a runout at strength 1 [m].
const OFF_M: f64 = 10e-6;

/// Part of a bias that is not yet there at first, and how long it takes [s].
const SETTLES: (f64, f64) = (0.05, 3.0);

/// Higher waves of a surface that is out of true, part of the first.
const LOBES: [f64; 2] = [0.06, 0.03];

/// Part that a reading grows by at strength 1, and part of that which is lost where it is at
/// its largest.
const GAIN: (f64, f64) = (0.05, 0.1);

/// Sag of a bow at strength 1 [m].
const BOW_M: f64 = 20e-6;

/// Pull of a coupling at strength 1, part of a nominal load; along y, and four times a turn, part
/// of that.
const COUPLING: (f64, f64, f64) = (0.05, 0.3, 0.1);

/// Part of a bearing's stiffness that is missing at strength 1, along x and y.
const SOFTER: [f64; 2] = [0.3, 0.24];

/// An effect with its strength, written `NAME=STRENGTH` or `NAME@TARGET=STRENGTH`.
///
/// Targets: a channel for `sensor-bias` and `gain-error`, a node with sensors for `runout`,
/// `left` or `right` for `misalignment`, the number of a bearing from 1 for
/// `bearing-stiffness`; one that is drawn where absent.
#[derive(Clone, Debug, PartialEq)]
pub struct RotorEffect {
    name: &'static str,
    target: Option<String>,
    strength: f64,
}

impl FromStr for RotorEffect {
    type Err = SimulateError;

    fn from_str(text: &str) -> Result<Self, SimulateError> {
        let (place, strength) = text.split_once('=').unwrap_or((text, "1"));
        let (name, target) = match place.split_once('@') {
            Some((name, target)) => (name, Some(target.to_owned())),
            None => (place, None),
        };
        let Some((name, _)) = ROTOR_EFFECTS.into_iter().find(|effect| effect.0 == name) else {
            return Err(SimulateError::Effect {
                found: name.into(),
                allowed: ROTOR_EFFECTS.map(|effect| effect.0).join(", "),
            });
        };
        let most = if name == "bearing-stiffness" {
            3.0
        } else {
            100.0
        };
        let strength = (strength.parse().ok())
            .filter(|s: &f64| (0.0..=most).contains(s))
            .ok_or_else(|| SimulateError::OwnStrength {
                effect: name,
                found: strength.into(),
                allowed: format!("0 to {most}, 1 is typical"),
            })?;
        Ok(Self {
            name,
            target,
            strength,
        })
    }
}

/// An effect where it acts.
#[derive(Clone, Debug)]
pub(crate) enum Placed {
    /// Channel, offset in the end [m].
    Bias(usize, f64),
    /// Node, runout [m], angles of its waves [rad].
    Runout(usize, f64, [f64; 3]),
    /// Channel, strength.
    Gain(usize, f64),
    /// Sag [m], its angle [rad].
    Bow(f64, f64),
    /// Node, pull [N], angle [rad].
    Coupling(usize, f64, f64),
    /// Bearing, strength.
    Softer(usize, f64),
}

impl RotorEffect {
    /// Where it acts on `machine`, individual number `individual`.
    pub(crate) fn placed(
        &self,
        machine: &Machine,
        rotor: &Rotor,
        individual: u64,
    ) -> Result<Placed, SimulateError> {
        let target = self.target.as_deref();
        let purpose = format!("effect {}@{}", self.name, target.unwrap_or(""));
        let mut rng = Draw::new(&purpose, individual, individual).individual;
        let sensed: Vec<usize> = (machine.channels.iter()).filter_map(node).collect();
        let channels: Vec<&str> = machine.channels.iter().map(|c| c.name.as_str()).collect();
        let nodes: Vec<String> = sensed.iter().map(ToString::to_string).collect();
        let bearings: Vec<String> = (1..=rotor.bearings.len())
            .map(|number| number.to_string())
            .collect();
        let mut among = |names: &[&str]| match target {
            None if names.is_empty() => Err(SimulateError::NothingToActOn { effect: self.name }),
            None => Ok(rng.random_range(0..names.len())),
            Some(found) => (names.iter().position(|name| *name == found)).ok_or_else(|| {
                SimulateError::Target {
                    effect: self.name,
                    found: found.into(),
                    allowed: names.join(", "),
                }
            }),
        };
        let strength = self.strength;
        Ok(match self.name {
            "sensor-bias" => Placed::Bias(among(&channels)?, strength * OFF_M),
            "gain-error" => Placed::Gain(among(&channels)?, strength),
            "runout" => {
                let node = sensed[among(&words(&nodes))?];
                let angles = std::array::from_fn(|_| rng.random_range(0.0..TAU));
                Placed::Runout(node, strength * OFF_M, angles)
            }
            "shaft-bow" => Placed::Bow(strength * BOW_M, rng.random_range(0.0..TAU)),
            "misalignment" => {
                let ends = [0, rotor.nodes() - 1];
                let node = ends[among(&["left", "right"])?];
                let pull = strength * COUPLING.0 * rotor.loads[0].nominal_n;
                Placed::Coupling(node, pull, rng.random_range(0.0..TAU))
            }
            _ => Placed::Softer(among(&words(&bearings))?, strength),
        })
    }
}

fn words(list: &[String]) -> Vec<&str> {
    list.iter().map(String::as_str).collect()
}

/// The node whose displacement a channel senses.
fn node(channel: &Channel) -> Option<usize> {
    match &channel.senses {
        Senses::Displacement(at) => Some(at.node),
        _ => None,
    }
}

impl Placed {
    /// Changes the rotor that the plant is made of.
    pub fn soften(&self, rotor: &mut Rotor) {
        let Self::Softer(bearing, strength) = self else {
            return;
        };
        let left = SOFTER.map(|part| (1.0 - part).powf(*strength));
        let soften = |k: &mut [[f64; 2]; 2]| {
            for (i, row) in k.iter_mut().enumerate() {
                for (j, value) in row.iter_mut().enumerate() {
                    *value *= (left[i] * left[j]).sqrt();
                }
            }
        };
        let RotorBearing {
            stiffness_n_per_m,
            table,
            ..
        } = &mut rotor.bearings[*bearing];
        let table = table.iter_mut().map(|at| &mut at.stiffness_n_per_m);
        for stiffness in stiffness_n_per_m.iter_mut().chain(table) {
            soften(stiffness);
        }
    }

    /// A further force on the shaft.
    pub fn pull(&self) -> Option<Pull> {
        match self {
            Self::Bow(..) => Some(Pull::Bow),
            Self::Coupling(node, ..) => Some(Pull::Node(*node)),
            _ => None,
        }
    }

    /// Its size along x and y at the shaft's `angle` [m, N].
    pub fn size(&self, angle: f64) -> [f64; 2] {
        match *self {
            Self::Bow(sag, at) => [sag * (angle + at).cos(), sag * (angle + at).sin()],
            Self::Coupling(_, pull, at) => {
                let (_, along_y, four) = COUPLING;
                let wave = (2.0 * angle + at).cos() + four * (4.0 * angle + at).cos();
                [pull * wave, along_y * pull * (2.0 * angle + at).sin()]
            }
            _ => [0.0, 0.0],
        }
    }

    /// Reading of channel `number` with the effect, given the `reading` without [m].
    pub fn read(&self, number: usize, channel: &Channel, t: f64, angle: f64, reading: f64) -> f64 {
        match *self {
            Self::Bias(of, offset) if of == number => {
                let (part, time_s) = SETTLES;
                reading + offset * (1.0 - part * (-t / time_s).exp())
            }
            Self::Runout(at, size, angles) => {
                let Senses::Displacement(place) = &channel.senses else {
                    return reading;
                };
                if place.node != at {
                    return reading;
                }
                // The place of the surface that passes the sensor.
                let passing = angle - place.direction_deg.to_radians();
                let lobes = (LOBES.iter().zip(&angles[1..]).zip([2.0, 3.0]))
                    .map(|((part, phase), lobe)| part * (lobe * passing + phase).cos())
                    .sum::<f64>();
                reading + size * ((passing + angles[0]).cos() + lobes)
            }
            Self::Gain(of, strength) if of == number => {
                let (part, lost) = GAIN;
                let largest = 1e-3_f64;
                let bent = lost * (reading / largest).powi(2).min(1.0);
                reading * (1.0 + strength * part * (1.0 - bent))
            }
            _ => reading,
        }
    }
}
