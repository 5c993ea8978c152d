//! `loadtwin tune`.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, ValueEnum};
use serde_json::{Map, Value, json};

use super::layout::LayoutFile;
use super::output::{note, say};
use super::plan::{Plan, Replace};
use super::progress::Progress;
use crate::atomic_file::{AtomicFile, Complete, publish};
use crate::build::Sensors;
use crate::calibrate::{Description, with_noise};
use crate::files::content::Content;
use crate::machine::{Channel, Machine};
use crate::report::PAGE;
use crate::tune::{
    LoadNoise, MeasurementNoise, Method, Tuned, common_walk, measure_noise, page, rms,
    sampled_process_noise, tune_loads,
};

/// First column of a response.
const FREQUENCY: &str = "f [Hz]";

/// What is written as the response of the estimated to the true loads.
const RESPONSE: Content = Content {
    noun: "frequency response",
    suffixes: &["csv"],
    is_same: |file| Ok(file.header().starts_with(FREQUENCY.as_bytes())),
};

/// Draws of the Monte Carlo check of the process noise.
const DRAWS: usize = 2000;

/// Choose the noise of the filter from recordings and from the wanted bandwidth.
///
/// Of a drivetrain: R over the carrier angle from the errors of the model in the first
/// recording, which should be at constant load and have reference loads; Qd of
/// the loads for each set of sensors, by the likelihood one for all of them. Of a
/// rotor: walk of the loads, model error, spread
/// before the first sample and noise of the sensors, by the likelihood of the
/// innovations and by the differential evolution of the paper, side by side.
#[derive(Debug, Args)]
pub struct Tune {
    /// Machine description (TOML), calibrated.
    pub(super) machine: PathBuf,
    /// Recordings (CSV, Parquet or MDF4); the first at constant load.
    #[arg(required = true)]
    pub(super) recordings: Vec<PathBuf>,
    /// Only this set of sensors.
    #[arg(long, value_name = "NAME")]
    pub(super) sensors: Option<String>,
    /// How the noise is chosen: on a drivetrain that of the loads' steps, frf where
    /// absent; on a rotor all of it, likelihood where absent.
    #[arg(long, value_enum)]
    pub(super) method: Option<Choice>,
    /// A recording that takes no part and on which the methods for a rotor are judged;
    /// without it the first of those that are tuned on.
    #[arg(long, value_name = "RECORDING")]
    pub(super) validate: Option<PathBuf>,
    /// Also say what the other methods would choose.
    #[arg(long)]
    pub(super) compare: bool,
    /// Highest frequency at which the loads are wanted [Hz]; the description's where absent.
    #[arg(long, value_name = "HZ")]
    pub(super) cutoff: Option<f64>,
    /// Leave R as described.
    #[arg(long)]
    pub(super) keep_r: bool,
    /// Write the response of the estimated to the true loads to FILE.csv.
    #[arg(long, value_name = "FILE")]
    pub(super) response: Option<PathBuf>,
    /// Write a page with the response and the noise of the channels to FILE.html.
    #[arg(long, value_name = "FILE")]
    pub(super) report: Option<PathBuf>,
    /// Write the tuned description to FILE.toml, with its noise map beside it.
    #[arg(short, long, value_name = "FILE")]
    pub(super) output: Option<PathBuf>,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    layout: LayoutFile,
}

/// How the noise is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Choice {
    /// Closed-loop frequency response near 1 below the cut-off and near 0
    /// above, weighed by bandwidth (the paper's eq. (23)).
    Frf,
    /// The same with each band averaged by itself: faster and noisier.
    FrfPerBand,
    /// Least norm of the innovations.
    Innovation,
    /// Corner of the L-curve.
    LCurve,
    /// Largest likelihood of the innovations; of several sets of sensors the median is written.
    Likelihood,
    /// On a rotor: differential evolution on the paper's two objectives.
    Evolution,
}

impl Choice {
    /// The method for a drivetrain.
    fn method(self) -> anyhow::Result<Method> {
        Ok(match self {
            Self::Frf => Method::Frf,
            Self::FrfPerBand => Method::FrfPerBand,
            Self::Innovation => Method::Innovation,
            Self::LCurve => Method::LCurve,
            Self::Likelihood => Method::Likelihood,
            Self::Evolution => anyhow::bail!(
                "--method: found evolution, allowed on a drivetrain: frf, frf-per-band, \
                 innovation, l-curve, likelihood"
            ),
        })
    }
}

/// One tuned set of sensors.
struct Set {
    name: String,
    tuned: Tuned,
    seconds: f64,
}

/// Walk of each load that is written for each set, `[set][load]` [N m/sqrt(s)].
///
/// Which bandwidth a set can reach differs from set to set, how the loads moved does not.
fn chosen_walks(sets: &[Set], method: Method) -> Vec<Vec<f64>> {
    let told = || {
        sets.iter()
            .map(|set| set.tuned.methods[0].1.walk.as_slice())
    };
    match method {
        Method::Likelihood => vec![common_walk(&told().collect::<Vec<_>>()); sets.len()],
        _ => told().map(<[f64]>::to_vec).collect(),
    }
}

impl Tune {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        Plan::new(self.replace)
            .description(&self.machine)
            .reads(self.layout.file())
            .reads(self.recordings.iter().chain(&self.validate))
            .writes("--response", self.response.as_deref(), RESPONSE)
            .writes("--report", self.report.as_deref(), PAGE)
            .writes_description("--output", self.output.as_deref())
            .check(as_json)?;
        let described = self.layout.machine(&self.machine)?;
        if let Some(rotor) = &described.rotor {
            return self.run_rotor(&described, rotor, as_json);
        }
        anyhow::ensure!(
            self.validate.is_none(),
            "--validate: there is nothing to judge on a drivetrain; allowed: a machine with [rotor]"
        );
        let method = self.method.unwrap_or(Choice::Frf).method()?;
        let cutoff_hz = self.cutoff.unwrap_or(described.tuning.cutoff_hz);
        let started = Instant::now();
        let folder = crate::files::scratch::Scratch::new()?;
        let noise = if self.keep_r {
            Vec::new()
        } else {
            let progress = Progress::new("noise");
            measure_noise(&described, &self.recordings[0], |part| progress.show(part))?
        };
        let measured = noise.iter().map(|(i, noise)| (*i, noise));
        let machine = with_noise(&described, measured, folder.path())?;
        let noise_seconds = started.elapsed().as_secs_f64();
        let mut methods = vec![method];
        if self.compare {
            methods.extend(Method::ALL.into_iter().filter(|m| *m != method));
        }
        let names: Vec<Option<String>> = match (&self.sensors, machine.sensor_sets.as_slice()) {
            (Some(name), _) => vec![Some(name.clone())],
            (None, []) => vec![None],
            (None, sets) => sets.iter().map(|set| Some(set.name.clone())).collect(),
        };
        let progress = Progress::new("tune");
        let mut sets = Vec::new();
        for (k, name) in names.iter().enumerate() {
            let started = Instant::now();
            let sensors = Sensors::choose(&machine, name.as_deref())?;
            let tuned = tune_loads(
                &machine,
                &sensors,
                &self.recordings,
                cutoff_hz,
                &methods,
                |part| {
                    progress.show((k as f64 + part) / names.len() as f64);
                },
            )?;
            sets.push(Set {
                name: sensors.name,
                tuned,
                seconds: started.elapsed().as_secs_f64(),
            });
        }
        drop(progress);
        let walks = chosen_walks(&sets, method);
        let mut files = Vec::new();
        if let Some(output) = &self.output {
            files = complete(&described, &machine, &names, &walks, output)?;
        }
        if let Some(path) = &self.response {
            files.push(complete_response(&machine, &sets, path)?);
        }
        if let Some(path) = &self.report {
            let tuned: Vec<(&str, &Tuned)> = sets
                .iter()
                .map(|set| (set.name.as_str(), &set.tuned))
                .collect();
            files.push(page(&machine, cutoff_hz, &noise, &tuned).complete(path)?);
        }
        publish(files)?;
        if as_json {
            let out = json!({
                "machine": machine.name,
                "recordings": self.recordings,
                "cutoff_hz": cutoff_hz,
                "method": method.name(),
                "noise": noise.iter().map(|(i, n)| noise_report(&machine.channels[*i], n)).collect::<Vec<_>>(),
                "noise_seconds": noise_seconds,
                "process_noise": process_noise(&machine),
                "sets": sets.iter().zip(&walks).map(|(set, walk)| report(&machine, set, walk)).collect::<Vec<_>>(),
                "machine_out": self.output,
                "seconds": started.elapsed().as_secs_f64(),
            });
            say!("{out}");
        } else {
            print(&machine, &sets);
            for doubt in doubts(&machine, &sets, &walks) {
                note(format_args!("{doubt}\n"));
            }
        }
        Ok(())
    }
}

/// Largest ratio of drawn to first-order standard deviations over the states.
fn process_noise(machine: &Machine) -> Value {
    let Some(drivetrain) = &machine.drivetrain else {
        return Value::Null;
    };
    let (dt_s, std) = (1.0 / machine.rate_hz, machine.tuning.parameter_std);
    let drawn = sampled_process_noise(drivetrain, dt_s, std, DRAWS, 1);
    let zero = vec![0.0; drawn.nrows()];
    let first = crate::gearbox::process_noise(drivetrain, dt_s, std, &zero);
    let ratios: Vec<f64> = (0..drawn.nrows())
        .filter(|i| first[(*i, *i)] > 0.0)
        .map(|i| (drawn[(i, i)] / first[(i, i)]).sqrt())
        .collect();
    json!({ "parameter_std": std, "draws": DRAWS, "drawn_to_first_order_std": ratios })
}

/// Where a set tells another size of walk than the one that is written for it.
fn doubts(machine: &Machine, sets: &[Set], walks: &[Vec<f64>]) -> Vec<String> {
    const FACTOR: f64 = 10.0;
    let mut doubts = Vec::new();
    for (set, chosen) in sets.iter().zip(walks) {
        let told = &set.tuned.methods[0].1.walk;
        for (load, (told, chosen)) in load_names(machine).zip(told.iter().zip(chosen)) {
            if !(chosen / FACTOR..=chosen * FACTOR).contains(told) {
                doubts.push(format!(
                    "{}: alone it tells a walk of {load} of {told:.3e} N m/sqrt(s), most others {chosen:.3e}, \
                     which is taken: its model or its noise may be wrong",
                    set.name
                ));
            }
        }
    }
    doubts
}

fn load_names(machine: &Machine) -> impl Iterator<Item = &str> {
    let loads = machine.drivetrain.iter().flat_map(|d| &d.loads);
    loads.map(|load| load.name.as_str())
}

fn report(machine: &Machine, set: &Set, walk: &[f64]) -> Value {
    let loads = |noise: &LoadNoise| -> Map<String, Value> {
        load_names(machine)
            .map(str::to_owned)
            .zip(noise.walk.iter().zip(&noise.log10_qd))
            .map(|(name, (walk, qd))| (name, json!({ "walk_nm_per_sqrt_s": walk, "log10_qd": qd })))
            .collect()
    };
    let methods: Map<String, Value> = set
        .tuned
        .methods
        .iter()
        .map(|(method, noise)| {
            let mut entry = loads(noise);
            if let Some(outcome) = noise.outcome {
                entry.insert("misfit".into(), json!(outcome.misfit));
                entry.insert("innovation_norm".into(), json!(outcome.innovation));
                entry.insert("solution_norm".into(), json!(outcome.load));
            }
            (method.name().to_owned(), Value::Object(entry))
        })
        .collect();
    let chosen: Map<String, Value> = load_names(machine)
        .zip(walk)
        .map(|(name, walk)| (name.to_owned(), json!(walk)))
        .collect();
    json!({
        "sensors": set.name, "methods": methods, "walk_nm_per_sqrt_s": chosen, "seconds": set.seconds,
    })
}

fn print(machine: &Machine, sets: &[Set]) {
    let mut header = format!("{:<24}{:<13}", "log10 Qd", "method");
    for load in load_names(machine) {
        header += &format!("{load:>18}");
    }
    say!("{header}{:>12}{:>12}{:>8}", "misfit", "innovation", "s");
    for set in sets {
        for (method, noise) in &set.tuned.methods {
            let mut line = format!("{:<24}{:<13}", set.name, method.name());
            for qd in &noise.log10_qd {
                line += &format!("{qd:>18.2}");
            }
            if let Some(outcome) = noise.outcome {
                line += &format!("{:>12.3}{:>12.3}", outcome.misfit, outcome.innovation);
            } else {
                line += &format!("{:>12}{:>12}", "-", "-");
            }
            say!("{line}{:>8.1}", set.seconds);
        }
    }
}

/// The description with the walks of each set and R, and its maps, without names yet.
fn complete(
    described: &Machine,
    machine: &Machine,
    names: &[Option<String>],
    walks: &[Vec<f64>],
    output: &Path,
) -> anyhow::Result<Vec<Complete>> {
    let mut description = Description::read(&described.path)?;
    let loads: Vec<&str> = load_names(machine).collect();
    for (name, walk) in names.iter().zip(walks) {
        let walks = || loads.iter().copied().zip(walk.iter().copied());
        match name {
            Some(name) => {
                description.set_numbers("sensor_set", name, "walk_nm_per_sqrt_s", walks());
            }
            None => {
                for (load, walk) in walks() {
                    description.set_number("drivetrain.load", load, "walk_nm_per_sqrt_s", walk);
                }
            }
        }
    }
    Ok(description.with_gauges(described, machine, output)?)
}

fn noise_report(channel: &Channel, noise: &MeasurementNoise) -> Value {
    let own = |values: &[f64]| channel.unit.from_si(rms(values));
    json!({
        "channel": channel.name, "unit": channel.unit.symbol(),
        "std": own(&noise.scaled), "std_eq_15": own(&noise.plain),
    })
}

/// `|H|` of each load and set over the frequency.
fn complete_response(machine: &Machine, sets: &[Set], path: &Path) -> anyhow::Result<Complete> {
    let loads: Vec<&str> = load_names(machine).collect();
    let mut text = String::from(FREQUENCY);
    for set in sets {
        for load in &loads {
            text += &format!(",{} {load} [1]", set.name);
        }
    }
    text.push('\n');
    let rows = sets.first().map_or(0, |set| set.tuned.response.len());
    for i in 0..rows {
        text += &format!("{:.4}", sets[0].tuned.response[i].0);
        for set in sets {
            for magnitude in &set.tuned.response[i].1 {
                text += &format!(",{magnitude:.5}");
            }
        }
        text.push('\n');
    }
    let mut file = AtomicFile::create(path)?;
    std::io::Write::write_all(&mut file, text.as_bytes())?;
    Ok(file.complete()?)
}
