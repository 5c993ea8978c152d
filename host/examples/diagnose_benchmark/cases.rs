//! Random cases of the benchmark: machine with its parameters drawn anew, effects, profile and
//! seed; the simulation of its recordings.

use std::error::Error;
use std::path::Path;

use loadtwin::machine::Machine;
use loadtwin::recording::{Block, Writer};
use loadtwin::simulate::{Applied, Scenario, Simulation};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::outside::{Change, OUTSIDE};

/// Effects of the simulated plant that the library has a candidate for; the two
/// share no code.
const EFFECTS: [&str; 24] = [
    "backlash",
    "torque-ripple",
    "torsional-resonance",
    "coulomb-friction",
    "stribeck-friction",
    "viscous-friction",
    "load-friction",
    "presliding-hysteresis",
    "gauge-position",
    "gauge-creep",
    "thermal-drift",
    "gain-error",
    "thermal-gain",
    "carrier-order",
    "planet-sharing",
    "bending-load",
    "strain-nonlinearity",
    "channel-delay",
    "gauge-step",
    "gauge-debonding",
    "mains-pick-up",
    "dropped-bits",
    "stuck-values",
    "encoder-eccentricity",
];

const PROFILES: [&str; 4] = ["start-stop", "reversals", "steps", "turbulent"];

/// Length of each recording [s].
pub const DURATION_S: f64 = 90.0;

/// Part of the samples of some column that an effect must change to be observable.
const SHOWN: f64 = 1e-3;

/// Strength from which an effect counts as strong.
pub const STRONG: f64 = 0.3;

/// Recordings of each machine.
pub const OF_EACH: usize = 10;

/// What a recording holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    One,
    Two,
    Clean,
    Outside,
}

/// One recording, and another of the same machine that takes no part in the fit.
#[derive(Clone)]
pub struct Case {
    pub machine: usize,
    pub kind: Kind,
    /// Names and strengths.
    pub effects: Vec<(String, f64)>,
    pub profile: &'static str,
    unseen_profile: &'static str,
    individual: u64,
    seeds: [u64; 2],
}

/// Machines and cases of `seed`.
pub fn drawn(described: &Machine, machines: usize, seed: u64) -> (Vec<Machine>, Vec<Case>) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let machines: Vec<Machine> = (0..machines)
        .map(|_| another(described, &mut rng))
        .collect();
    let cases = (0..machines.len())
        .flat_map(|machine| (0..OF_EACH).map(move |number| (machine, number)))
        .map(|(machine, number)| case(machine, number, &mut rng))
        .collect();
    (machines, cases)
}

/// The description with inertias, stiffness, noise and gauges drawn anew.
fn another(described: &Machine, rng: &mut ChaCha8Rng) -> Machine {
    let mut machine = described.clone();
    let mut factor = |spread: f64| (spread * rng.random_range(-1.0_f64..1.0)).exp();
    if let Some(drivetrain) = &mut machine.drivetrain {
        for inertia in &mut drivetrain.inertias {
            inertia.moment_kg_m2 *= factor(0.3);
            inertia.drag_nm_s_per_rad *= factor(0.5);
        }
        for shaft in &mut drivetrain.shafts {
            shaft.stiffness_nm_per_rad *= factor(0.3);
            shaft.damping_nm_s_per_rad *= factor(0.3);
        }
        drivetrain.nominal_speed_rad_s *= factor(0.2);
    }
    for channel in &mut machine.channels {
        channel.noise_std *= factor(0.5);
    }
    machine.sensor_sets.clear();
    // Some gauges are not there.
    for _ in 0..rng.random_range(0..4) {
        let gone = rng.random_range(0..machine.channels.len());
        machine.channels.remove(gone);
    }
    machine
}

fn case(machine: usize, number: usize, rng: &mut ChaCha8Rng) -> Case {
    let mut effect = || {
        let name = EFFECTS[rng.random_range(0..EFFECTS.len())];
        (name.to_owned(), rng.random_range(0.1..1.6))
    };
    let (kind, effects) = match number {
        0..4 => (Kind::One, vec![effect()]),
        4..6 => (Kind::Clean, Vec::new()),
        6..8 => {
            let first = effect();
            let mut second = effect();
            while second.0 == first.0 {
                second = effect();
            }
            (Kind::Two, vec![first, second])
        }
        _ => {
            let strength = rng.random_range(0.5..1.6);
            let name = OUTSIDE[rng.random_range(0..OUTSIDE.len())];
            (Kind::Outside, vec![(name.to_owned(), strength)])
        }
    };
    let mut profile = || PROFILES[rng.random_range(0..PROFILES.len())];
    Case {
        machine,
        kind,
        effects,
        profile: profile(),
        unseen_profile: profile(),
        individual: rng.random(),
        seeds: rng.random(),
    }
}

impl Case {
    /// Names and strengths in one word each.
    pub fn truth(&self) -> String {
        let words: Vec<String> = self
            .effects
            .iter()
            .map(|(name, strength)| format!("{name}={strength:.3}"))
            .collect();
        words.join(" ")
    }

    /// Writes the recording to be diagnosed to `fitted` and the hold-out recording to `held_out`.
    pub fn record(
        &self,
        machine: &Machine,
        fitted: &Path,
        held_out: &Path,
    ) -> Result<(), Box<dyn Error>> {
        self.write(machine, self.profile, self.seeds[0], fitted)?;
        self.write(machine, self.unseen_profile, self.seeds[1], held_out)
    }

    /// The same with the next profile in which the recording that is to be diagnosed shows each of
    /// the effects, so that the label says what it holds; as it was drawn, and false, where none does.
    pub fn shown(&self, machine: &Machine) -> Result<(Self, bool), Box<dyn Error>> {
        let drawn = PROFILES.iter().position(|profile| *profile == self.profile);
        let mut profiles = PROFILES;
        profiles.rotate_left(drawn.unwrap_or(0));
        for profile in profiles {
            let case = Self {
                profile,
                ..self.clone()
            };
            if case.shows(machine)? {
                return Ok((case, true));
            }
        }
        Ok((self.clone(), false))
    }

    /// Whether the recording that is to be diagnosed shows each of the effects: the same recording
    /// without it, or with what it is where it has slid all along, with the same noise, differs
    /// somewhere.
    fn shows(&self, machine: &Machine) -> Result<bool, Box<dyn Error>> {
        for i in 0..self.effects.len() {
            let mut others = self.effects.clone();
            let (name, strength) = others.remove(i);
            if name == "presliding-hysteresis" {
                others.push(("coulomb-friction".to_owned(), strength));
            }
            let with = self.simulation(machine, self.profile, self.seeds[0], &self.effects)?;
            let without = self.simulation(machine, self.profile, self.seeds[0], &others)?;
            let enough = SHOWN * with.rows() as f64;
            let mut differing = Vec::new();
            let shown = with.zip(without).any(|(a, b)| {
                differing.resize(a.columns.len(), 0);
                for (n, of_block) in differing.iter_mut().zip(unequal(&a, &b)) {
                    *n += of_block;
                }
                differing.iter().any(|n| *n as f64 >= enough)
            });
            if !shown {
                return Ok(false);
            }
        }
        Ok(true)
    }

    fn simulation(
        &self,
        machine: &Machine,
        profile: &str,
        seed: u64,
        effects: &[(String, f64)],
    ) -> Result<Simulation, Box<dyn Error>> {
        let mut scenario = Scenario::by_name(profile)?;
        scenario.duration_s = DURATION_S;
        let applied: Vec<Applied> = effects
            .iter()
            .filter(|(name, strength)| self.change(machine, name, *strength).is_none())
            .map(|(name, strength)| format!("{name}={strength}").parse())
            .collect::<Result<_, _>>()?;
        let individual = Some(self.individual);
        Ok(Simulation::new(
            machine, &scenario, seed, individual, &applied,
        )?)
    }

    /// What is done to the recording itself.
    fn change(&self, machine: &Machine, name: &str, strength: f64) -> Option<Change> {
        Change::new(machine, name, strength, self.individual)
    }

    fn write(
        &self,
        machine: &Machine,
        profile: &str,
        seed: u64,
        path: &Path,
    ) -> Result<(), Box<dyn Error>> {
        let simulation = self.simulation(machine, profile, seed, &self.effects)?;
        let mut changes: Vec<Change> = (self.effects.iter())
            .filter_map(|(name, strength)| self.change(machine, name, *strength))
            .collect();
        let mut writer = Writer::create(path, simulation.columns(), &[])?;
        for mut block in simulation {
            for change in &mut changes {
                change.apply(&mut block);
            }
            let columns: Vec<&[f64]> = block.columns.iter().flatten().map(Vec::as_slice).collect();
            writer.write(&block.t, &columns)?;
        }
        Ok(writer.finish()?)
    }
}

/// Whether two samples differ by more than rounding errors.
fn differ(x: f64, y: f64) -> bool {
    x.is_nan() != y.is_nan() || (x - y).abs() > 1e-9 * x.abs().max(y.abs())
}

/// How many samples differ, column by column.
fn unequal(a: &Block, b: &Block) -> Vec<usize> {
    let columns = a.columns.iter().flatten().zip(b.columns.iter().flatten());
    columns
        .map(|(a, b)| {
            let pairs = a.iter().zip(b);
            pairs.filter(|(x, y)| differ(**x, **y)).count()
        })
        .collect()
}
