//! Injects effects that the estimator's model lacks into the simulated drivetrain and its sensors,
//! for `loadtwin simulate --effect`: list of all effects, parsing of name, target and strength, and
//! application to plant, gauges and encoders.

mod bending;
mod carrier_order;
mod data_faults;
mod delay;
mod drift;
mod eccentricity;
mod friction;
mod gauge_position;
mod lower_peak;
mod mains_interference;
mod nonlinearity;
mod parameter_spread;
mod sudden_change;
mod torsion;
mod zero_and_gain;

use std::str::FromStr;

use rand::RngExt;

use crate::SimulateError;
use crate::chain_parameters::Chain;
use crate::rng::Draw;
use crate::simulated_encoder::Encoder;
use crate::simulated_gauge::Gauge;
use loadtwin_machine::Machine;

/// An effect of the plant that a recording does not declare.
pub struct Effect {
    /// What `--effect` calls it.
    pub name: &'static str,
    /// What a strength of 1 means; other strengths are in proportion.
    pub typical: &'static str,
    apply: Apply,
}

/// Where an effect acts.
enum Apply {
    Drivetrain(fn(&mut Chain, &mut Dose) -> Acted),
    Gauges(Scope, fn(&mut [&mut Gauge], &mut Dose)),
    Encoder(fn(&mut Encoder, &mut Dose)),
}

/// Whether there was something to act on.
type Acted = bool;

/// On which channels an effect acts where no target is given.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Scope {
    Every,
    /// One that is drawn.
    One,
    /// Those of the group that responds least.
    WeakestGroup,
    /// Those with narrow peaks over the carrier angle.
    Intermittent,
}

/// How much of an effect, and its random numbers.
struct Dose {
    strength: f64,
    duration_s: f64,
    draw: Draw,
}

/// Every effect there is.
pub static EFFECTS: &[Effect] = &[
    parameter_spread::SPREAD,
    torsion::BACKLASH,
    torsion::MESH_STIFFNESS,
    torsion::RIPPLE,
    torsion::RESONANCE,
    friction::COULOMB,
    friction::STRIBECK,
    friction::VISCOUS,
    friction::LOAD_DEPENDENT,
    friction::PRESLIDING,
    gauge_position::POSITION,
    lower_peak::OVERESTIMATED,
    drift::CREEP,
    drift::THERMAL,
    zero_and_gain::OFFSET,
    zero_and_gain::GAIN,
    zero_and_gain::THERMAL,
    carrier_order::CARRIER_ORDER,
    carrier_order::PLANET_SHARING,
    bending::BENDING,
    nonlinearity::NONLINEARITY,
    delay::DELAY,
    sudden_change::STEP,
    sudden_change::DEBONDING,
    sudden_change::BURSTS,
    mains_interference::MAINS_INTERFERENCE,
    data_faults::DROPPED_BITS,
    data_faults::STUCK,
    data_faults::MISSING,
    eccentricity::ECCENTRICITY,
];

/// The preset `paper`: what the paper's test bench showed, with strengths.
///
/// The error of the ring gear's peaks is the residual after the model update: the
/// paper's results are those of the updated model.
///
/// Source: Bosmans et al. 2023, sections 4.2, 5.3.2 and 6.2.
const PAPER: [(&str, f64); 7] = [
    ("parameter-spread", 1.0),
    ("gauge-position", 1.0),
    ("gauge-offset", 1.0),
    ("peak-overestimated", 0.3),
    ("gauge-creep", 1.0),
    ("backlash", 1.0),
    ("mesh-stiffness", 1.0),
];

/// An effect with its strength, written `NAME=STRENGTH` or
/// `NAME@TARGET=STRENGTH`.
#[derive(Clone)]
pub struct Applied {
    effect: &'static Effect,
    /// Channel, group of channels or encoder; the effect's own choice where absent.
    target: Option<String>,
    strength: f64,
    /// Whether a machine without anything to act on is no error.
    optional: bool,
}

impl Applied {
    /// The effects of a list in which `paper` is replaced by all those that the
    /// paper's test bench showed.
    ///
    /// What a machine has nothing for (ring-gear peaks, ...) is then left out.
    ///
    /// # Errors
    /// As those of parsing one effect.
    pub fn list<T: AsRef<str>>(texts: &[T]) -> Result<Vec<Self>, SimulateError> {
        let mut list = Vec::new();
        for text in texts.iter().map(AsRef::as_ref) {
            if text == "paper" {
                list.extend(PAPER.iter().filter_map(|(name, strength)| {
                    let effect = EFFECTS.iter().find(|effect| effect.name == *name)?;
                    Some(Self {
                        effect,
                        target: None,
                        strength: *strength,
                        optional: true,
                    })
                }));
            } else {
                list.push(text.parse()?);
            }
        }
        Ok(list)
    }
}

impl FromStr for Applied {
    type Err = SimulateError;

    fn from_str(text: &str) -> Result<Self, SimulateError> {
        let (name, strength) = text.split_once('=').unwrap_or((text, "1"));
        let (name, target) = match name.split_once('@') {
            Some((name, target)) => (name, Some(target.to_owned())),
            None => (name, None),
        };
        let effect = EFFECTS
            .iter()
            .find(|effect| effect.name == name)
            .ok_or_else(|| SimulateError::Effect {
                found: name.into(),
                allowed: EFFECTS
                    .iter()
                    .map(|e| e.name)
                    .collect::<Vec<_>>()
                    .join(", "),
            })?;
        let strength = strength
            .parse()
            .ok()
            .filter(|s: &f64| (0.0..=100.0).contains(s))
            .ok_or_else(|| SimulateError::Strength {
                effect: effect.name,
                found: strength.into(),
            })?;
        Ok(Self {
            effect,
            target,
            strength,
            optional: false,
        })
    }
}

/// The machine that is simulated, as far as effects change it.
pub(crate) struct Individual {
    pub chain: Chain,
    pub gauges: Vec<Gauge>,
    pub encoders: Vec<Encoder>,
}

impl Applied {
    /// Changes `individual`; one of strength 0 changes nothing at all.
    pub(crate) fn apply(
        &self,
        individual: &mut Individual,
        machine: &Machine,
        duration_s: f64,
        draw: Draw,
    ) -> Result<(), SimulateError> {
        let mut dose = Dose {
            strength: self.strength,
            duration_s,
            draw,
        };
        let target = self.target.as_deref();
        let acted = match &self.effect.apply {
            Apply::Drivetrain(apply) => {
                if target.is_some() {
                    return Err(self.no_target("none: it acts on the drivetrain".into()));
                }
                self.strength == 0.0 || apply(&mut individual.chain, &mut dose)
            }
            Apply::Gauges(scope, apply) => {
                let mut gauges = select(&mut individual.gauges, *scope, target, &mut dose);
                if gauges.is_empty() && target.is_some() {
                    return Err(self.no_target(gauge_names(machine)));
                }
                if self.strength != 0.0 && !gauges.is_empty() {
                    apply(&mut gauges, &mut dose);
                }
                !gauges.is_empty()
            }
            Apply::Encoder(apply) => {
                let encoder = match target {
                    Some(name) => individual.encoders.iter_mut().find(|e| e.name == name),
                    None => individual.encoders.first_mut(),
                };
                let found = encoder.is_some();
                if !found && target.is_some() {
                    let names: Vec<_> = machine.encoders.iter().map(|e| e.name.as_str()).collect();
                    return Err(self.no_target(names.join(", ")));
                }
                if let Some(encoder) = encoder.filter(|_| self.strength != 0.0) {
                    apply(encoder, &mut dose);
                }
                found
            }
        };
        if acted || self.optional {
            Ok(())
        } else {
            Err(SimulateError::NothingToActOn {
                effect: self.effect.name,
            })
        }
    }

    /// Names the random numbers of this effect.
    pub(crate) fn purpose(&self) -> String {
        format!(
            "effect {}@{}",
            self.effect.name,
            self.target.as_deref().unwrap_or("")
        )
    }

    fn no_target(&self, allowed: String) -> SimulateError {
        SimulateError::Target {
            effect: self.effect.name,
            found: self.target.clone().unwrap_or_default(),
            allowed,
        }
    }
}

fn gauge_names(machine: &Machine) -> String {
    let mut names: Vec<&str> = machine.channels.iter().map(|c| c.name.as_str()).collect();
    for group in machine.channels.iter().filter_map(|c| c.group.as_deref()) {
        if !names.contains(&group) {
            names.push(group);
        }
    }
    names.join(", ")
}

fn select<'a>(
    gauges: &'a mut [Gauge],
    scope: Scope,
    target: Option<&str>,
    dose: &mut Dose,
) -> Vec<&'a mut Gauge> {
    let weakest = weakest_group(gauges);
    // Drives and tachometers are no gauges; without a target they are not changed.
    let count = gauges.iter().filter(|g| g.is_load_sensor).count().max(1);
    let drawn = dose.draw.individual.random_range(0..count);
    let mut sensors = 0;
    gauges
        .iter_mut()
        .filter(|gauge| {
            if let Some(name) = target {
                return gauge.name == name || gauge.group.as_deref() == Some(name);
            }
            sensors += usize::from(gauge.is_load_sensor);
            gauge.is_load_sensor
                && match scope {
                    Scope::Every => true,
                    Scope::One => sensors == drawn + 1,
                    Scope::WeakestGroup => gauge.group == weakest,
                    Scope::Intermittent => gauge.map.is_intermittent(),
                }
        })
        .collect()
}

/// The group with the smallest mean reading at nominal load.
fn weakest_group(gauges: &[Gauge]) -> Option<String> {
    let mean = |group: &Option<String>| {
        let spans: Vec<f64> = gauges
            .iter()
            .filter(|g| g.is_load_sensor && g.group == *group)
            .map(Gauge::span)
            .collect();
        spans.iter().sum::<f64>() / spans.len().max(1) as f64
    };
    gauges
        .iter()
        .filter(|g| g.is_load_sensor)
        .map(|g| (mean(&g.group), &g.group))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .and_then(|(_, group)| group.clone())
}
