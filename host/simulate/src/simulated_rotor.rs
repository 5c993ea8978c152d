//! Simulates recordings of a rotor with unbalance at constant speed, in a run-up or along a
//! recorded course: sensors, encoders, forces and displacements of all nodes, one row for each
//! sample.
//!
//! Nothing here is shared with the estimator but the machine description: twice
//! as many elements, integrated numerically from the shape functions, in their modes
//! ([`crate::rotor_plant`]); Runge-Kutta steps with the speed as it is at each moment.

use std::f64::consts::TAU;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use crate::error::SimulateError;
use crate::injected_rotor_effect::{Placed, RotorEffect};
use crate::recorder::{Recorder, Sampled, check_duration};
use crate::rng::Draw;
use crate::rotor_plant::{Moment, Plant};
use loadtwin_machine::{Machine, Rotor, Senses};
use loadtwin_recording::{OutputColumn, Unit};

/// What the bench does; name and what it is.
pub const ROTOR_SCENARIOS: [(&str, &str); 2] = [
    (
        "constant",
        "from rest in the bearings, at constant speed, the unbalance acting at once",
    ),
    (
        "run-up",
        "from the lowest to the highest speed of the schedule",
    ),
];

/// Largest angle of the fastest mode in one Runge-Kutta step [rad].
const STEP_RAD: f64 = 0.5;

/// Largest exponent of a decay in one step, less than the 2.78 up to which the steps are stable.
const STEP_DECAY: f64 = 2.0;

/// A force that the plant applies at one node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AppliedUnbalance {
    /// Mass times distance [kg m].
    pub moment_kg_m: f64,
    /// Angle at time 0 (rad).
    pub phase_rad: f64,
}

/// How a recording of a rotor is made.
#[derive(Clone, Debug, PartialEq)]
pub struct RotorScenario {
    /// Length (s).
    pub duration_s: f64,
    /// Speed at the start and at the end [rad/s], linear between.
    pub speeds_rad_s: [f64; 2],
    /// One for each load of the description.
    pub unbalances: Vec<AppliedUnbalance>,
    /// Noise of the sensors, in that of the description.
    pub noise: f64,
    /// Draws the noise.
    pub seed: u64,
}

impl RotorScenario {
    /// The scenario `name`; `seed` draws unbalances of half to the whole nominal load.
    ///
    /// # Errors
    /// When there is no such scenario.
    pub fn by_name(
        name: &str,
        rotor: &Rotor,
        seed: u64,
        duration_s: Option<f64>,
    ) -> Result<Self, SimulateError> {
        let (speeds_rad_s, usual_s) = match (name, rotor.schedule_rad_s) {
            ("constant", _) => ([rotor.speed_rad_s; 2], 2.0),
            ("run-up", Some(schedule)) => (schedule, 10.0),
            ("run-up", None) => {
                return Err(SimulateError::Scenario {
                    found: name.into(),
                    allowed: "constant; run-up where rotor.schedule_rad_s gives its speeds".into(),
                });
            }
            _ => {
                let names: Vec<&str> = ROTOR_SCENARIOS.iter().map(|(name, _)| *name).collect();
                return Err(SimulateError::Scenario {
                    found: name.into(),
                    allowed: names.join(", "),
                });
            }
        };
        let mut rng = Draw::new("unbalance", seed, seed).individual;
        let unbalances = (rotor.loads.iter())
            .map(|load| AppliedUnbalance {
                moment_kg_m: rng.random_range(0.5..1.0) * load.nominal_n
                    / rotor.speed_rad_s.powi(2),
                phase_rad: rng.random_range(0.0..TAU),
            })
            .collect();
        let duration_s = duration_s.unwrap_or(usual_s);
        check_duration(duration_s)?;
        Ok(Self {
            duration_s,
            speeds_rad_s,
            unbalances,
            noise: 1.0,
            seed,
        })
    }
}

/// How a shaft turned, sample by sample.
#[derive(Clone, Debug, PartialEq)]
pub struct RotorCourse {
    /// Sample period (s).
    pub dt_s: f64,
    /// Angle (rad).
    pub angle: Vec<f64>,
    /// Speed [rad/s].
    pub speed: Vec<f64>,
}

impl RotorCourse {
    /// Between two samples the speed changes evenly.
    fn at(&self, t: f64) -> Motion {
        let last = self.speed.len() - 1;
        let i = ((t / self.dt_s) as usize).min(last);
        let past = t - i as f64 * self.dt_s;
        let next = (i + 1).min(last);
        let acceleration = (self.speed[next] - self.speed[i]) / self.dt_s;
        Motion {
            angle: self.angle[i] + past * (self.speed[i] + 0.5 * past * acceleration),
            speed: self.speed[i] + past * acceleration,
            acceleration,
        }
    }
}

/// A recording of a rotor in the making: sensors, encoder, forces, displacements of every
/// node.
pub type RotorSimulation<'a> = Recorder<TurningRotor<'a>>;

/// A turning rotor with its sensors.
pub struct TurningRotor<'a> {
    machine: &'a Machine,
    rotor: &'a Rotor,
    scenario: RotorScenario,
    /// In place of the scenario's speeds.
    course: Option<RotorCourse>,
    effects: Vec<Placed>,
    plant: Plant,
    rng: ChaCha8Rng,
    dt: f64,
    steps: usize,
}

impl<'a> RotorSimulation<'a> {
    /// Sets up the recording of `scenario`.
    ///
    /// # Errors
    /// When the rotor cannot be computed.
    pub fn new(
        machine: &'a Machine,
        rotor: &'a Rotor,
        scenario: RotorScenario,
    ) -> Result<Self, SimulateError> {
        let seed = scenario.seed;
        Self::with_effects(machine, rotor, scenario, seed, &[])
    }

    /// As [`Self::new`], with what individual number `individual` has beyond its description.
    ///
    /// # Errors
    /// When the rotor cannot be computed, or has nothing that an effect could act on.
    pub fn with_effects(
        machine: &'a Machine,
        rotor: &'a Rotor,
        scenario: RotorScenario,
        individual: u64,
        effects: &[RotorEffect],
    ) -> Result<Self, SimulateError> {
        let effects = (effects.iter())
            .map(|effect| effect.placed(machine, rotor, individual))
            .collect::<Result<Vec<_>, _>>()?;
        Self::turning(machine, rotor, scenario, None, effects)
    }

    /// As [`Self::new`], turning as `course` says and not as `scenario`.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn along(
        machine: &'a Machine,
        rotor: &'a Rotor,
        scenario: RotorScenario,
        course: RotorCourse,
    ) -> Result<Self, SimulateError> {
        Self::turning(machine, rotor, scenario, Some(course), Vec::new())
    }

    fn turning(
        machine: &'a Machine,
        rotor: &'a Rotor,
        scenario: RotorScenario,
        turned: Option<RotorCourse>,
        effects: Vec<Placed>,
    ) -> Result<Self, SimulateError> {
        let mut real = rotor.clone();
        for effect in &effects {
            effect.soften(&mut real);
        }
        let pulls: Vec<_> = effects.iter().filter_map(Placed::pull).collect();
        let plant = Plant::new(&real, &pulls).ok_or_else(|| SimulateError::NotHeld {
            machine: machine.name.clone(),
        })?;
        let dt = 1.0 / machine.rate_hz;
        let steps = (plant.fastest() * dt / STEP_RAD).max(plant.damped() * dt / STEP_DECAY);
        let steps = steps.ceil().max(1.0) as usize;
        let (seed, duration_s) = (scenario.seed, scenario.duration_s);
        let [from, to] = scenario.speeds_rad_s;
        let course = if from == to { "constant" } else { "run-up" };
        let rotor = TurningRotor {
            machine,
            rotor,
            rng: Draw::new("sensors", seed, seed).recording,
            scenario,
            course: turned,
            effects,
            plant,
            dt,
            steps,
        };
        let columns = rotor.columns();
        Ok(Self::start(
            rotor, columns, machine, course, seed, duration_s,
        ))
    }
}

impl TurningRotor<'_> {
    fn columns(&self) -> Vec<OutputColumn> {
        let channels = (self.machine.channels.iter()).map(|c| (c.name.clone(), c.unit));
        let encoders = (self.machine.encoders.iter()).map(|e| (e.name.clone(), Unit::COUNTS));
        let references = (self.machine.references.iter()).map(|r| (r.name.clone(), r.unit));
        let nodes = (0..self.rotor.nodes())
            .flat_map(|node| ["x", "y"].map(|axis| (format!("node{node}_{axis}"), Unit::METRE)));
        channels
            .chain(encoders)
            .chain(references)
            .chain(nodes)
            .map(|(name, unit)| OutputColumn {
                name,
                unit,
                single: false,
            })
            .collect()
    }

    fn motion(&self, t: f64) -> Motion {
        if let Some(course) = &self.course {
            return course.at(t);
        }
        let [from, to] = self.scenario.speeds_rad_s;
        let acceleration = (to - from) / self.scenario.duration_s;
        Motion {
            angle: from * t + 0.5 * acceleration * t * t,
            speed: from + acceleration * t,
            acceleration,
        }
    }

    /// Forces along x and y of each load [N], then what effects pull with.
    fn forces(&self, motion: &Motion) -> Vec<f64> {
        (self.scenario.unbalances.iter())
            .flat_map(|unbalance| {
                let (sine, cosine) = (motion.angle + unbalance.phase_rad).sin_cos();
                let (radial, along) = (
                    unbalance.moment_kg_m * motion.speed.powi(2),
                    unbalance.moment_kg_m * motion.acceleration,
                );
                [
                    radial * cosine + along * sine,
                    radial * sine - along * cosine,
                ]
            })
            .chain(
                (self.effects.iter())
                    .filter(|effect| effect.pull().is_some())
                    .flat_map(|effect| effect.size(motion.angle)),
            )
            .collect()
    }
}

impl Sampled for TurningRotor<'_> {
    fn sample(&mut self, row: u64, columns: &mut [Vec<f64>]) {
        let t = row as f64 * self.dt;
        let motion = self.motion(t);
        let forces = self.forces(&motion);
        let q = self.plant.displacements(&forces);
        let mut values = Vec::with_capacity(columns.len());
        for (number, channel) in self.machine.channels.iter().enumerate() {
            if let Senses::Displacement(at) = &channel.senses {
                let (sine, cosine) = at.direction_deg.to_radians().sin_cos();
                let along = q[2 * at.node] * cosine + q[2 * at.node + 1] * sine;
                let noise = self.rng.sample::<f64, _>(StandardNormal);
                let noise = self.scenario.noise * channel.to_si(channel.noise_std) * noise;
                let response = channel.sensitivity.unwrap_or(1.0) * along;
                let reading = (self.effects.iter()).fold(response, |reading, effect| {
                    effect.read(number, channel, t, motion.angle, reading)
                }) + channel.to_si(channel.offset + channel.runout_at(motion.angle))
                    + noise;
                let lsb = channel.lsb_si();
                values.push(channel.unit.from_si((reading / lsb).round() * lsb));
            }
        }
        for encoder in &self.machine.encoders {
            values.push((motion.angle / TAU * encoder.counts_per_turn).floor());
        }
        for reference in &self.machine.references {
            let names = self.rotor.loads.iter().flat_map(|l| &l.names);
            let force = (names.zip(&forces))
                .find(|(name, _)| **name == reference.load)
                .map_or(f64::NAN, |(_, force)| *force);
            values.push(reference.unit.from_si(force / reference.gain) + reference.zero);
        }
        values.extend(q);
        for (column, value) in columns.iter_mut().zip(values) {
            column.push(value);
        }
    }

    fn advance(&mut self, row: u64) {
        let h = self.dt / self.steps as f64;
        for step in 0..self.steps {
            let t = row as f64 * self.dt + step as f64 * h;
            let at = |part: f64| {
                let motion = self.motion(t + part * h);
                Moment {
                    speed: motion.speed,
                    acceleration: motion.acceleration,
                    forces: self.forces(&motion),
                }
            };
            let moments = [at(0.0), at(0.5), at(1.0)];
            self.plant.step(h, &moments);
        }
    }
}

/// The shaft's rotation at one moment.
struct Motion {
    angle: f64,
    speed: f64,
    acceleration: f64,
}
