//! What `diagnose` says of effects that it is not told.
//!
//! `cargo run --release -p loadtwin --example diagnose_benchmark -- [MACHINES] [SEED]`
//!
//! For each machine (a description with its parameters drawn anew) ten
//! recordings: four with one effect, two clean, two with two effects, two with
//! something outside the library. Effect, strength (0.1 to 1.6), profile and
//! noise are drawn. The labels go to a file that is read only after every
//! recording was diagnosed.

use std::collections::BTreeMap;
use std::error::Error;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use loadtwin::diagnose::{self, Verdict};
use loadtwin::machine::Machine;
use loadtwin::recording::{Block, Writer};
use loadtwin::simulate::{Applied, Scenario, Simulation};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

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

const OUTSIDE: [&str; 4] = [
    "bursts",
    "slipping-coupling",
    "loose-contact",
    "interference",
];

/// Length of each recording [s].
const DURATION_S: f64 = 90.0;

struct Case {
    machine: usize,
    kind: &'static str,
    effects: Vec<(String, f64)>,
    profile: &'static str,
    seed: u64,
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let machines: usize = arguments.next().map_or(Ok(20), |a| a.parse())?;
    let seed: u64 = arguments.next().map_or(Ok(1), |a| a.parse())?;
    let folder = tempfile::tempdir()?;
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../examples/gearbox/machine.toml");
    let described = Machine::load(&path)?;
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let machines: Vec<Machine> = (0..machines).map(|_| drawn(&described, &mut rng)).collect();
    let mut labels = String::new();
    let mut recordings = Vec::new();
    for (number, case) in cases(machines.len(), &mut rng).into_iter().enumerate() {
        let seen = folder.path().join(format!("{number}.parquet"));
        record(&machines[case.machine], &case, &seen)?;
        let names: Vec<String> = case
            .effects
            .iter()
            .map(|(name, strength)| format!("{name}={strength:.3}"))
            .collect();
        writeln!(labels, "{};{};{}", case.kind, case.profile, names.join(" "))?;
        recordings.push((case.machine, seen));
    }
    let label_file = folder.path().join("labels");
    std::fs::write(&label_file, labels)?;

    let mut said = Vec::new();
    for (number, (machine, recording)) in recordings.iter().enumerate() {
        let started = std::time::Instant::now();
        let found = told(&machines[*machine], recording)?;
        eprintln!(
            "{number}: {} [{:.1} s]",
            found.join(" "),
            started.elapsed().as_secs_f64()
        );
        said.push(found);
    }
    score(&std::fs::read_to_string(&label_file)?, &said);
    Ok(())
}

/// The description with inertias, stiffness, noise and gauges drawn anew.
fn drawn(described: &Machine, rng: &mut ChaCha8Rng) -> Machine {
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

fn cases(machines: usize, rng: &mut ChaCha8Rng) -> Vec<Case> {
    let mut cases = Vec::new();
    for machine in 0..machines {
        for number in 0..10 {
            let mut effect = || {
                let name = EFFECTS[rng.random_range(0..EFFECTS.len())];
                (name.to_owned(), rng.random_range(0.1..1.6))
            };
            let (kind, effects) = match number {
                0..4 => ("one", vec![effect()]),
                4..6 => ("clean", Vec::new()),
                6..8 => {
                    let first = effect();
                    let mut second = effect();
                    while second.0 == first.0 {
                        second = effect();
                    }
                    ("two", vec![first, second])
                }
                _ => {
                    let strength = rng.random_range(0.5..1.6);
                    let name = OUTSIDE[rng.random_range(0..OUTSIDE.len())];
                    ("outside", vec![(name.to_owned(), strength)])
                }
            };
            cases.push(Case {
                machine,
                kind,
                effects,
                profile: PROFILES[rng.random_range(0..PROFILES.len())],
                seed: rng.random(),
            });
        }
    }
    cases
}

fn record(machine: &Machine, case: &Case, path: &Path) -> Result<(), Box<dyn Error>> {
    let mut scenario = Scenario::by_name(case.profile)?;
    scenario.duration_s = DURATION_S;
    let mut applied = Vec::new();
    let mut own = None;
    for (name, strength) in &case.effects {
        if OUTSIDE[1..].contains(&name.as_str()) {
            own = Some((name.as_str(), *strength));
        } else {
            applied.push(format!("{name}={strength}").parse::<Applied>()?);
        }
    }
    let simulation = Simulation::new(machine, &scenario, case.seed, None, &applied)?;
    let Some((name, strength)) = own else {
        return Ok(simulation.write(path, |_| ())?);
    };
    let mut rng = ChaCha8Rng::seed_from_u64(case.seed);
    let columns = simulation.columns().to_vec();
    let mut writer = Writer::create(path, &columns, &[])?;
    let mut change = Change::new(machine, name, strength, &mut rng);
    for mut block in simulation {
        change.apply(&mut block);
        let columns: Vec<&[f64]> = block.columns.iter().flatten().map(Vec::as_slice).collect();
        writer.write(&block.t, &columns)?;
    }
    Ok(writer.finish()?)
}

/// What is done to a recording that no effect of the library does.
struct Change {
    name: String,
    strength: f64,
    column: usize,
    /// Reading of the channel at nominal load, about.
    span: f64,
    /// When it happens [s].
    moments: Vec<f64>,
}

impl Change {
    fn new(machine: &Machine, name: &str, strength: f64, rng: &mut ChaCha8Rng) -> Self {
        let channel = rng.random_range(0..machine.channels.len());
        let column = if name == "slipping-coupling" {
            // The first encoder comes after the channels.
            machine.channels.len()
        } else {
            channel
        };
        let mut moments: Vec<f64> = (0..24).map(|_| rng.random_range(0.0..DURATION_S)).collect();
        moments.sort_by(f64::total_cmp);
        Self {
            name: name.to_owned(),
            strength,
            column,
            span: 60e-6,
            moments,
        }
    }

    fn apply(&mut self, block: &mut Block) {
        let Some(Some(column)) = block.columns.get_mut(self.column) else {
            return;
        };
        for (t, value) in block.t.iter().zip(column) {
            let before = self.moments.iter().filter(|m| **m <= *t).count();
            match self.name.as_str() {
                // The encoder loses 8 mrad at each of the moments.
                "slipping-coupling" => {
                    *value += (20.0 * self.strength * before as f64).round();
                }
                // The channel reads less between every other two moments.
                "loose-contact" if before % 2 == 1 => *value *= 1.0 - 0.2 * self.strength,
                // An oscillation whose frequency wanders.
                "interference" => {
                    let phase = 40.0 * t + 60.0 * (0.37 * t).sin() + 25.0 * (0.9 * t).cos();
                    *value += 0.03 * self.strength * self.span * phase.sin();
                }
                _ => {}
            }
        }
    }
}

/// The verdict's word, and the names.
fn told(machine: &Machine, recording: &Path) -> Result<Vec<String>, Box<dyn Error>> {
    let paths: [PathBuf; 1] = [recording.to_owned()];
    let diagnosis = diagnose::diagnose(machine, &paths, &[], |_| ())?;
    let mut said = vec![diagnosis.verdict.word().to_owned()];
    if let Verdict::Effects(names) | Verdict::Inseparable(names) = &diagnosis.verdict {
        said.extend(names.iter().map(ToString::to_string));
    }
    Ok(said)
}

fn score(labels: &str, said: &[Vec<String>]) {
    let mut confusion: BTreeMap<(String, String), usize> = BTreeMap::new();
    // For each kind: right, of how many.
    let mut tally: BTreeMap<&str, (usize, usize)> = BTreeMap::new();
    let mut count = |key: &'static str, right: bool| {
        let entry = tally.entry(key).or_default();
        entry.0 += usize::from(right);
        entry.1 += 1;
    };
    for (line, said) in labels.lines().zip(said) {
        let mut parts = line.split(';');
        let (kind, profile) = (parts.next().unwrap_or(""), parts.next().unwrap_or(""));
        let truth: Vec<(&str, f64)> = parts
            .next()
            .unwrap_or("")
            .split_whitespace()
            .filter_map(|e| e.split_once('='))
            .map(|(name, s)| (name, s.parse().unwrap_or(0.0)))
            .collect();
        let unknown = said[0] == "unknown";
        let first = said.get(1).map_or(said[0].as_str(), String::as_str);
        match kind {
            "one" => {
                let (name, strength) = truth[0];
                let right = first == name;
                count(
                    if strength >= 0.3 {
                        "first right, strength 0.3 and more"
                    } else {
                        "first right, weaker"
                    },
                    right,
                );
                count("unknown said inside the library", unknown);
                *confusion.entry((name.into(), first.into())).or_default() += 1;
                if !right {
                    println!("{name}={strength:.2} ({profile}): {}", said.join(" "));
                }
            }
            "clean" => {
                count("false alarms", said[0] != "none");
                if said[0] != "none" {
                    println!("clean ({profile}): {}", said.join(" "));
                }
            }
            "two" => {
                let mut wanted: Vec<&str> = truth.iter().map(|t| t.0).collect();
                let mut found: Vec<&str> = said[1..].iter().map(String::as_str).collect();
                wanted.sort_unstable();
                found.sort_unstable();
                count("two, exact", wanted == found);
                count("two, first among them", wanted.contains(&first));
                count("unknown said inside the library", unknown);
                if wanted != found {
                    println!("{truth:?} ({profile}): {}", said.join(" "));
                }
            }
            _ => {
                count("unknown said outside the library", unknown);
                if !unknown {
                    println!("{} ({profile}): {}", truth[0].0, said.join(" "));
                }
            }
        }
    }
    println!("\neffect -> said (first)");
    for ((truth, said), n) in &confusion {
        println!("{truth:<26}{said:<26}{n:>4}");
    }
    println!();
    for (key, (right, of)) in &tally {
        println!(
            "{key:<40}{right:>4} of {of:>4}  {:.0} %",
            100.0 * *right as f64 / *of as f64
        );
    }
}
