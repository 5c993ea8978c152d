//! The command `loadtwin tune`: chooses measurement noise R and random walks of the loads of a
//! drivetrain from recordings, evaluates both on hold-out data, and writes the tuned description
//! for the sensor sets that are not worse. A rotor goes to `tune_rotor.rs`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::{Args, ValueEnum};
use rayon::prelude::*;
use serde_json::{Value, json};

use super::file_plan::{Plan, Replace};
use super::layout_option::LayoutFile;
use super::printing::{note, say, shown, shown_all};
use super::progress::Progress;
use super::tune_output::{
    check_lines, check_report, complete_response, load_names, noise_report, print, process_noise,
    reached, report, shortfalls, warnings,
};
use crate::atomic_file::{Complete, publish};
use crate::calibrate::{Description, with_noise};
use crate::error_band::with_error_bands;
use crate::files::file_kind::FileKind;
use crate::files::scratch::Scratch;
use crate::image_build::Sensors;
use crate::machine::Machine;
use crate::origin::with_origin;
use crate::recording::columns;
use crate::report::PAGE;
use crate::tune::{
    Check, Descriptions, HOLDOUT_PART, Holdout, MeasurementNoise, Method, Training, Tuned,
    common_walk, measure_noise, page, tune_loads,
};

/// What is written as the response of the estimated to the true loads.
const RESPONSE: FileKind = FileKind {
    noun: "frequency response",
    suffixes: &["csv"],
    is_same: |file| {
        Ok(file
            .header()
            .starts_with(super::tune_output::FREQUENCY.as_bytes()))
    },
};

/// Choose the noise of the filter from recordings and from the wanted bandwidth.
///
/// Of a drivetrain: R over the carrier angle from the errors of the model in the first
/// recording, which should be at constant load and have reference loads; Qd of
/// the loads for each set of sensors, with `likelihood` one for all sets. Of a
/// rotor: walk of the loads, model error, spread
/// before the first sample and noise of the sensors, by the likelihood of the
/// innovations and by the differential evolution of the paper, side by side.
///
/// Of a drivetrain the described and the tuned noise run on data that took no part. Written are the
/// walks of sets that are shown not to be worse: the error of no load rises by more than 0.1 % of
/// nominal at the upper end of its 95 % interval (without references: they are not less likely). If
/// nothing remains, nothing is written and the exit code is 1.
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
    /// How the noise is chosen. Drivetrain: of the loads' steps; where absent `reference` if a
    /// recording has reference loads, else `likelihood`. Rotor: all noise; where absent
    /// `likelihood`.
    #[arg(long, value_enum)]
    pub(super) method: Option<Choice>,
    /// A recording that takes no part and on which the noise is evaluated; without it the last
    /// third of each recording, which is held out.
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
    /// Least mean absolute error to the reference loads.
    Reference,
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
            Self::Reference => Method::Reference,
            Self::Evolution => anyhow::bail!(
                "--method: found evolution, allowed on a drivetrain: frf, frf-per-band, \
                 innovation, l-curve, likelihood, reference"
            ),
        })
    }
}

/// One tuned set of sensors.
pub(super) struct Set {
    pub(super) name: String,
    pub(super) tuned: Tuned,
    pub(super) seconds: f64,
}

/// Walk of each load that is written for each set, by set and load (N m/sqrt(s)).
///
/// Which bandwidth a set can reach differs from set to set, how the loads moved does not.
fn chosen_walks(sets: &[Set], method: Method) -> Vec<Vec<f64>> {
    let estimated = || {
        sets.iter()
            .map(|set| set.tuned.methods[0].1.walk.as_slice())
    };
    match method {
        Method::Likelihood => vec![common_walk(&estimated().collect::<Vec<_>>()); sets.len()],
        _ => estimated().map(<[f64]>::to_vec).collect(),
    }
}

/// R and the walks of all sets, with what they come to on the hold-out data.
struct Attempt {
    noise: Vec<(usize, MeasurementNoise)>,
    machine: Machine,
    sets: Vec<Set>,
    /// Walks of the loads of each of `sets`.
    walks: Vec<Vec<f64>>,
    /// Each set of the description, the tuned ones first.
    checks: Vec<Check>,
    /// Holds the noise map.
    _folder: Scratch,
}

impl Attempt {
    /// Whether measured R makes no set worse.
    fn is_accepted(&self) -> bool {
        !self.checks.iter().any(Check::refuses_noise)
    }

    /// Whether the tuned noise of some set is written; R alone is not, for nothing shows that it
    /// helps.
    fn has_news(&self) -> bool {
        self.is_accepted() && self.checks.iter().any(Check::takes_walks)
    }
}

impl Tune {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        Plan::new(self.replace)
            .description(&self.machine)
            .reads(self.layout.file())
            .reads_held_out(&self.recordings, &self.validate)
            .writes("--response", self.response.as_deref(), RESPONSE)
            .writes("--report", self.report.as_deref(), PAGE)
            .writes_description("--output", self.output.as_deref())
            .check(as_json)?;
        let described = self.layout.machine(&self.machine)?;
        if let Some(rotor) = &described.rotor {
            return self.run_rotor(&described, rotor, as_json);
        }
        let method = match self.method {
            Some(choice) => choice.method()?,
            None => default_method(&described, &self.recordings)?,
        };
        let started = Instant::now();
        let mut attempt = self.attempt(&described, method, !self.keep_r)?;
        if !attempt.is_accepted() {
            let refused = attempt.checks.iter().filter(|check| check.refuses_noise());
            for worse in refused.filter_map(|check| check.measured.as_ref()) {
                note(format_args!(
                    "R stays as described, for with measured R this is not shown to be no worse: {}\n",
                    worse.line()
                ));
            }
            attempt = self.attempt(&described, method, false)?;
        }
        let cutoff_hz = self.cutoff.unwrap_or(described.tuning.cutoff_hz);
        if as_json {
            let mut out = self.json(&attempt, method, cutoff_hz);
            out["seconds"] = json!(started.elapsed().as_secs_f64());
            say!("{out}");
        } else {
            print(&attempt.machine, &attempt.sets);
            say!("{}:", self.holdout_text());
            for check in &attempt.checks {
                for line in check_lines(check) {
                    say!("  {line}");
                }
            }
            for warning in warnings(&attempt.machine, &attempt.sets, &attempt.walks) {
                note(format_args!("{warning}\n"));
            }
            for short in shortfalls(&attempt.machine, &attempt.sets, cutoff_hz) {
                note(format_args!("{short}\n"));
            }
        }
        anyhow::ensure!(
            self.output.is_none() || attempt.has_news(),
            "nothing is written: for no set of sensors is the tuned noise shown not to be worse than the described \
             noise, by more than 0.1 % of a nominal load, or less likely ({}); give recordings that are more alike \
             those of use, another --method, or leave the description as it is",
            self.holdout_text()
        );
        self.publish(&described, &attempt, cutoff_hz)
    }

    /// Recordings to tune on, without what is held out.
    pub(super) fn training(&self) -> Training<'_> {
        let part = match self.validate {
            Some(_) => 1.0,
            None => 1.0 - HOLDOUT_PART,
        };
        Training {
            recordings: &self.recordings,
            part,
        }
    }

    pub(super) fn holdout(&self) -> Holdout<'_> {
        match &self.validate {
            Some(recording) => Holdout {
                recordings: std::slice::from_ref(recording),
                part: 1.0,
            },
            None => Holdout {
                recordings: &self.recordings,
                part: HOLDOUT_PART,
            },
        }
    }

    pub(super) fn holdout_text(&self) -> String {
        match &self.validate {
            Some(recording) => format!("hold-out recording {}", recording.display()),
            None => "hold-out, the last third of each recording".into(),
        }
    }

    /// Tunes all sets that are asked for, with R measured or as described, and evaluates every set
    /// of the description.
    fn attempt(
        &self,
        described: &Machine,
        method: Method,
        measures: bool,
    ) -> anyhow::Result<Attempt> {
        let folder = Scratch::new()?;
        let noise = if measures {
            let progress = Progress::new("noise");
            let (recording, part) = (&self.recordings[0], self.training().part);
            measure_noise(described, recording, part, |part| progress.show(part))?
        } else {
            Vec::new()
        };
        let measured = noise.iter().map(|(i, noise)| (*i, noise));
        let machine = with_noise(described, measured, folder.path())?;
        let (names, others) = self.sets(&machine);
        let progress = Progress::new("tune");
        let mut sets = Vec::new();
        for (k, name) in names.iter().enumerate() {
            let part = |part| progress.show((k as f64 + part) / (names.len() + 1) as f64);
            sets.push(self.tuned(&machine, name.as_deref(), method, part)?);
        }
        let walks = chosen_walks(&sets, method);
        for (set, walk) in sets.iter_mut().zip(&walks) {
            set.tuned.response = set.tuned.response_with(walk);
        }
        let descriptions = Descriptions {
            described,
            measured: &machine,
        };
        let by_name: Vec<BTreeMap<String, f64>> = (walks.iter())
            .map(|walk| {
                load_names(&machine)
                    .map(str::to_owned)
                    .zip(walk.iter().copied())
                    .collect()
            })
            .collect();
        let tuned = names.iter().zip(by_name.iter().map(Some));
        // As described they need no check.
        let others = if noise.is_empty() { Vec::new() } else { others };
        let untuned = others.iter().map(|name| (name, None));
        let jobs: Vec<_> = tuned.chain(untuned).collect();
        let checks = jobs
            .into_par_iter()
            .map(|(name, walks)| self.holdout().check(descriptions, name.as_deref(), walks))
            .collect::<Result<Vec<_>, _>>()?;
        Ok(Attempt {
            noise,
            machine,
            sets,
            walks,
            checks,
            _folder: folder,
        })
    }

    fn tuned(
        &self,
        machine: &Machine,
        name: Option<&str>,
        method: Method,
        progress: impl Fn(f64),
    ) -> anyhow::Result<Set> {
        let started = Instant::now();
        let mut methods = vec![method];
        if self.compare {
            methods.extend(Method::ALL.into_iter().filter(|m| *m != method));
        }
        let cutoff_hz = self.cutoff.unwrap_or(machine.tuning.cutoff_hz);
        let sensors = Sensors::choose(machine, name)?;
        let tuned = tune_loads(
            machine,
            &sensors,
            self.training(),
            cutoff_hz,
            &methods,
            progress,
        )?;
        Ok(Set {
            name: sensors.name,
            tuned,
            seconds: started.elapsed().as_secs_f64(),
        })
    }

    /// Names of the sets that are tuned, and of the others.
    fn sets(&self, machine: &Machine) -> (Vec<Option<String>>, Vec<Option<String>>) {
        let all = || machine.sensor_sets.iter().map(|set| set.name.clone());
        match (&self.sensors, machine.sensor_sets.as_slice()) {
            (Some(name), _) => {
                let others = all().filter(|other| other != name).map(Some).collect();
                (vec![Some(name.clone())], others)
            }
            (None, []) => (vec![None], Vec::new()),
            (None, _) => (all().map(Some).collect(), Vec::new()),
        }
    }

    fn publish(
        &self,
        described: &Machine,
        attempt: &Attempt,
        cutoff_hz: f64,
    ) -> anyhow::Result<()> {
        let mut files = Vec::new();
        if let Some(output) = &self.output {
            let (names, _) = self.sets(&attempt.machine);
            let chosen: Vec<_> = (names.iter().zip(&attempt.walks).zip(&attempt.checks))
                .filter(|(_, check)| check.takes_walks())
                .map(|(set, _)| set)
                .collect();
            files = complete(described, &attempt.machine, &chosen, self.holdout(), output)?;
        }
        if let Some(path) = &self.response {
            files.push(complete_response(&attempt.machine, &attempt.sets, path)?);
        }
        if let Some(path) = &self.report {
            let tuned: Vec<(&str, &Tuned)> = (attempt.sets.iter())
                .map(|set| (set.name.as_str(), &set.tuned))
                .collect();
            let page = page(
                &attempt.machine,
                cutoff_hz,
                &attempt.noise,
                &tuned,
                &attempt.checks,
            );
            files.push(with_origin(page, Some(&attempt.machine.path)).complete(path)?);
        }
        Ok(publish(files)?)
    }

    fn json(&self, attempt: &Attempt, method: Method, cutoff_hz: f64) -> Value {
        let machine = &attempt.machine;
        let noise = attempt.noise.iter();
        let sets = attempt.sets.iter().zip(&attempt.walks).zip(&attempt.checks);
        json!({
            "machine": machine.name,
            "recordings": shown_all(&self.recordings),
            "cutoff_hz": cutoff_hz,
            "method": method.name(),
            "noise": noise.map(|(i, n)| noise_report(&machine.channels[*i], n)).collect::<Vec<_>>(),
            "process_noise": process_noise(machine),
            "sets": sets.map(|((set, walk), check)| {
                let mut out = report(machine, set, walk);
                out["walk_is_written"] = json!(check.takes_walks());
                out["reached_hz"] = reached(machine, set);
                out
            }).collect::<Vec<_>>(),
            "holdout": {
                "recordings": shown_all(self.holdout().recordings),
                "last_part": self.holdout().part,
                "sets": attempt.checks.iter().map(check_report).collect::<Vec<_>>(),
            },
            "machine_out": self.output.as_ref().filter(|_| attempt.has_news()).map(shown),
        })
    }
}

/// [`Method::Reference`] where a recording has a reference load, else the likelihood.
fn default_method(machine: &Machine, recordings: &[PathBuf]) -> anyhow::Result<Method> {
    let names: Vec<(&str, bool)> = machine
        .references
        .iter()
        .map(|r| (r.name.as_str(), false))
        .collect();
    for recording in recordings {
        let found = columns(recording, &machine.recording, &names)?;
        if found
            .iter()
            .any(|column| names.iter().any(|(name, _)| column.name == *name))
        {
            return Ok(Method::Reference);
        }
    }
    Ok(Method::Likelihood)
}

/// The description with the walks of each set of `chosen`, R and the error bands that they have on
/// `holdout`, and its maps, without names yet.
fn complete(
    described: &Machine,
    machine: &Machine,
    chosen: &[(&Option<String>, &Vec<f64>)],
    holdout: Holdout<'_>,
    output: &Path,
) -> anyhow::Result<Vec<Complete>> {
    let mut description = Description::read(&described.path)?;
    let mut changed = machine.clone();
    let loads: Vec<&str> = load_names(machine).collect();
    for (name, walk) in chosen {
        let walks = || loads.iter().copied().zip(walk.iter().copied());
        if let Some(name) = name {
            description.set_numbers("sensor_set", name, "walk_nm_per_sqrt_s", walks());
            let own = walks().map(|(load, walk)| (load.to_owned(), walk));
            let mut sets = changed.sensor_sets.iter_mut();
            if let Some(set) = sets.find(|set| set.name == *name) {
                set.walk_nm_per_sqrt_s = own.collect();
            }
        } else {
            let drivetrain = changed.drivetrain.iter_mut();
            for (load, walk) in drivetrain.flat_map(|d| &mut d.loads).zip(*walk) {
                description.set_number("drivetrain.load", &load.name, "walk_nm_per_sqrt_s", *walk);
                load.walk_nm_per_sqrt_s = Some(*walk);
            }
        }
    }
    let changed = with_error_bands(&changed, holdout.recordings, holdout.part);
    Ok(description.with_gauges(described, &changed, output)?)
}
