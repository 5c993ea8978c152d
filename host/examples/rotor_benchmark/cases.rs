//! Cases of the rotor benchmark: random rotors, sensors and strengths; 12 recordings of each rotor
//! by a fixed plan, with one, two or no effects. Simulates and diagnoses each, and decides whether
//! the result is the expected one (`Asked`).

use std::error::Error;
use std::path::Path;

use loadtwin::diagnose::{Diagnosis, RotorResiduals, Verdict, cannot_show, diagnose};
use loadtwin::machine::Machine;
use loadtwin::simulate::{RotorEffect, RotorScenario, RotorSimulation};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Effects that are tried.
const EFFECTS: [&str; 6] = [
    "sensor-bias",
    "runout",
    "gain-error",
    "shaft-bow",
    "misalignment",
    "bearing-stiffness",
];

/// Recordings of each rotor: each effect in a run-up, two effects, three that are clean, and what
/// an unbalance does as well at one speed.
pub const OF_EACH: usize = 12;

/// Length of a recording [s].
const DURATION_S: f64 = 8.0;

/// Samples a second.
const RATE_HZ: f64 = 1000.0;

/// Expected result of a case.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Asked {
    /// The effect is named, and no other.
    Named,
    /// Both are.
    BothNamed,
    /// Nothing is named.
    Nothing,
    /// Nothing else is named, and it is reported as not observable at this speed.
    Unobservable,
}

/// A recording.
pub struct Case {
    pub rotor: usize,
    pub asked: Asked,
    pub scenario: &'static str,
    /// Names and strengths.
    pub effects: Vec<(&'static str, f64)>,
    seed: u64,
}

/// Rotors after `described`, and their recordings.
pub fn drawn(described: &Machine, count: usize, seed: u64) -> (Vec<Machine>, Vec<Case>) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let rotors: Vec<Machine> = (0..count).map(|_| another(described, &mut rng)).collect();
    let cases = (0..count * OF_EACH)
        .map(|number| case(number / OF_EACH, number % OF_EACH, &mut rng))
        .collect();
    (rotors, cases)
}

/// Another shaft, other discs and bearings, an encoder, speeds about the first critical one.
fn another(described: &Machine, rng: &mut ChaCha8Rng) -> Machine {
    let mut machine = described.clone();
    machine.rate_hz = RATE_HZ;
    let encoder = format!(
        "name = \"shaft\"\ncounts_per_turn = {}\nbits = 16",
        [1024, 2048, 4096][rng.random_range(0..3)]
    );
    machine
        .encoders
        .push(toml::from_str(&encoder).expect("an encoder"));
    let noise = 1e-7 * 10.0_f64.powf(rng.random_range(0.0..1.0));
    machine
        .channels
        .iter_mut()
        .for_each(|channel| channel.noise_std = noise);
    let Some(rotor) = &mut machine.rotor else {
        return machine;
    };
    let outer = rng.random_range(0.016..0.021);
    rotor.sections[0].outer_m = outer;
    for disc in &mut rotor.discs {
        disc.mass_kg *= rng.random_range(0.7..1.4);
    }
    for bearing in &mut rotor.bearings {
        let mut soft = || 10.0_f64.powf(rng.random_range(5.7..7.0));
        bearing.stiffness_n_per_m = Some([[soft(), 0.0], [0.0, soft()]]);
        let mut damping = || rng.random_range(100.0..400.0);
        bearing.damping_n_s_per_m = [[damping(), 0.0], [0.0, damping()]];
    }
    // Critical speeds go with the diameter squared.
    let speed = 130.0 * (outer / 0.017).powi(2) * rng.random_range(0.9..1.1);
    rotor.schedule_rad_s = Some([0.4 * speed, 1.4 * speed]);
    rotor.speed_rad_s = rng.random_range(0.6..1.3) * speed;
    machine
}

fn case(rotor: usize, number: usize, rng: &mut ChaCha8Rng) -> Case {
    let mut strength = || 10.0_f64.powf(rng.random_range(-0.5..0.3));
    let (asked, scenario, effects) = match number {
        0..6 => (Asked::Named, "run-up", vec![(EFFECTS[number], strength())]),
        6 => {
            let (first, second) = (EFFECTS[rotor % 5], EFFECTS[(rotor + 2) % 5]);
            (
                Asked::BothNamed,
                "run-up",
                vec![(first, strength()), (second, strength())],
            )
        }
        7 | 8 => (Asked::Nothing, "run-up", Vec::new()),
        9 => (Asked::Nothing, "constant", Vec::new()),
        10 => (
            Asked::Unobservable,
            "constant",
            vec![("runout", strength())],
        ),
        _ => (
            Asked::Unobservable,
            "constant",
            vec![("shaft-bow", strength())],
        ),
    };
    Case {
        rotor,
        asked,
        scenario,
        effects,
        seed: rng.random(),
    }
}

impl Case {
    /// Names and strengths, and how it turned.
    pub fn truth(&self) -> String {
        let words: Vec<String> = (self.effects.iter())
            .map(|(name, strength)| format!("{name}={strength:.2}"))
            .collect();
        format!(
            "rotor {}, {}: {}",
            self.rotor,
            self.scenario,
            words.join(" ")
        )
    }

    /// Simulates the recording, diagnoses it, and returns whether the result is the one
    /// asked for, with its text.
    pub fn evaluate(&self, machine: &Machine) -> Result<(bool, String), Box<dyn Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("rotor.parquet");
        self.write(machine, &path)?;
        let diagnosis: Diagnosis<RotorResiduals> = diagnose(machine, &[path], &[], |_| ())?;
        let names = match &diagnosis.verdict {
            Verdict::Effects(names) | Verdict::Inseparable(names) => names.clone(),
            Verdict::None | Verdict::Unknown => Vec::new(),
        };
        let has = |(name, _): &(&'static str, f64)| names.contains(name);
        let unknown = diagnosis.verdict == Verdict::Unknown;
        // A surface with a runout has higher waves too, which no unbalance makes.
        let has_runout = self.effects.iter().any(|(name, _)| *name == "runout");
        let own = |name: &&str| {
            self.effects.iter().any(|(truth, _)| truth == name)
                || (has_runout && *name == "surface-lobes")
        };
        let right = match self.asked {
            Asked::Named | Asked::BothNamed => {
                names.iter().all(own) && self.effects.iter().all(has)
            }
            Asked::Nothing => names.is_empty() && !unknown,
            Asked::Unobservable => {
                let silent = cannot_show(&diagnosis.selection);
                let said = self
                    .effects
                    .iter()
                    .all(|effect| silent.contains(&effect.0) || has(effect));
                said && !unknown && names.iter().all(own)
            }
        };
        let error = diagnosis.errors.nominal;
        let percent =
            |interval: loadtwin::diagnose::Interval| interval.value_percent.unwrap_or(f64::NAN);
        let said = format!(
            "{} {}, residual {:.2} to {:.2} %",
            diagnosis.verdict.as_str(),
            names.join(" "),
            percent(error.before),
            percent(error.after)
        );
        Ok((right, said))
    }

    fn write(&self, machine: &Machine, path: &Path) -> Result<(), Box<dyn Error>> {
        let rotor = machine.rotor.as_ref().ok_or("no rotor")?;
        let scenario = RotorScenario::by_name(self.scenario, rotor, self.seed, Some(DURATION_S))?;
        let effects = (self.effects.iter())
            .map(|(name, strength)| format!("{name}={strength}").parse())
            .collect::<Result<Vec<RotorEffect>, _>>()?;
        let simulation =
            RotorSimulation::with_effects(machine, rotor, scenario, self.seed, &effects)?;
        Ok(simulation.write(path, |_| ())?)
    }
}
