//! What the balance of a measured drive lacks, found in its recordings.
//!
//! `drive = offset + inertia a + drag v + sum_j gain_j load_j + effects + rest`.
//! The linear part is what a description starts with; each effect is a physical
//! term with a few parameters ([`effect`]). Effects are added one by one where
//! they predict what took no part in the fit, and the result is reported on
//! recordings that took no part at all.

mod description;
mod design;
pub mod effect;
mod fit;
mod motion;
mod remainder;
mod selection;
mod smooth;

use std::path::{Path, PathBuf};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;
use thiserror::Error;

pub use effect::EFFECTS;
pub use remainder::Remainder;

use crate::machine::{Balance, BalanceEffect, Machine, Regime};
use crate::recording::RecordingError;
use design::Table;
use effect::{Effect, Scale};
use fit::{Columns, fit, shared};
use motion::Motion;
use selection::{LINEAR_PRIOR, Selection};

/// Resamples of the interval of an error.
const RESAMPLES: usize = 1000;

/// Fewest judged values that a diagnosis rests on.
const FEWEST: usize = 60;

/// Fewest recordings at steady speed.
const FEWEST_STEADY: usize = 8;

/// A remainder above this part of the drive that no effect explains [%] and
/// that has structure is something unknown.
const UNKNOWN_PERCENT: f64 = 10.0;

/// Why a balance cannot be diagnosed.
#[derive(Debug, Error)]
pub enum BalanceError {
    /// The description has no table `[balance]`.
    #[error("{}: no table [balance], which says what drives and what moves", .0.display())]
    NoBalance(PathBuf),
    /// A recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// A recording is too short.
    #[error("{}: found {found} rows, allowed: at least {allowed}", recording.display())]
    TooShort {
        /// Which.
        recording: PathBuf,
        /// Its rows.
        found: usize,
        /// Rows that are enough.
        allowed: usize,
    },
    /// All recordings together say too little.
    #[error("{found} {what}, allowed: at least {allowed}")]
    TooLittle {
        /// What was counted.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many are enough.
        allowed: usize,
    },
    /// The drive never changes.
    #[error("{}: the drive is the same in every row", .0.display())]
    Constant(PathBuf),
    /// The improved description cannot be written.
    #[error("{}: {reason}", path.display())]
    Write {
        /// Which file.
        path: PathBuf,
        /// Why not.
        reason: String,
    },
}

/// What is known after the loop is closed; the keys of `--json`.
#[derive(Debug, Serialize)]
pub struct Diagnosis {
    /// `none`, `effect`, `effects`, `inseparable` or `unknown`.
    pub verdict: &'static str,
    /// What was missing, in the order found.
    pub effects: Vec<FoundEffect>,
    /// For each effect, others that would do as well in its place.
    pub alternatives: Vec<Alternative>,
    /// What would tell them apart.
    pub next_experiment: Option<String>,
    /// Error on the validation recordings [% of the drive's RMS there].
    pub error: Errors,
    /// The linear part, fitted anew together with the effects.
    pub recalibrated: Linear,
    /// What no effect explains.
    pub remainder: Remainder,
    /// The drive is judged below this [Hz].
    pub cutoff_hz: f64,
    /// Recordings that were fitted.
    pub fitted_on: Vec<PathBuf>,
    /// Recordings that took no part in the fit.
    pub validated_on: Vec<Validated>,
    /// The improved description.
    pub machine_out: Option<PathBuf>,
}

/// An effect that was missing.
#[derive(Debug, Serialize)]
pub struct FoundEffect {
    /// Its name in the library.
    pub name: &'static str,
    /// Where it acts.
    pub channels: Vec<String>,
    /// Its shape, and the coefficient of each term.
    pub parameters: Parameters,
    /// How sure that is.
    pub evidence: FoundEvidence,
}

/// Parameters of an effect.
#[derive(Debug, Serialize)]
pub struct Parameters {
    /// See the effect's documentation.
    pub shape: Vec<f64>,
    /// Term and coefficient.
    pub terms: Vec<(String, f64)>,
}

/// How sure an effect is.
#[derive(Debug, Serialize)]
pub struct FoundEvidence {
    /// Fall of the error on what was left out of the fit, when it is added last [%].
    pub gain_percent: f64,
    /// Probability of that by chance, corrected for the number of candidates.
    pub p_value: f64,
}

/// Effects that would do as well as one that was found.
#[derive(Debug, Serialize)]
pub struct Alternative {
    /// The one that was found.
    pub effect: &'static str,
    /// The others, with their error in parts of its error.
    pub instead: Vec<(&'static str, f64)>,
}

/// An error before and after, with the linear part as described and fitted anew.
#[derive(Debug, Serialize)]
pub struct Errors {
    /// The linear part as described.
    pub nominal: BeforeAfter,
    /// The linear part fitted anew.
    pub recalibrated: BeforeAfter,
}

/// An error without and with the effects.
#[derive(Debug, Serialize)]
pub struct BeforeAfter {
    /// Without.
    pub before: Figure,
    /// With.
    pub after: Figure,
}

/// An error with its interval.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Figure {
    /// RMS of what is unexplained [% of the drive's RMS].
    pub value_percent: f64,
    /// 95 % interval by resampling stretches.
    pub interval_percent: [f64; 2],
}

/// The linear part of a balance.
#[derive(Clone, Debug, Serialize)]
pub struct Linear {
    /// [the drive's unit]
    pub offset: f64,
    /// Per acceleration.
    pub inertia: f64,
    /// Per speed.
    pub drag: f64,
    /// Factor on each measured load.
    pub load_gains: Vec<f64>,
}

/// Error on one validation recording.
#[derive(Debug, Serialize)]
pub struct Validated {
    /// Which.
    pub recording: PathBuf,
    /// Linear part fitted anew, without effects [% of the drive's RMS there].
    pub before_percent: f64,
    /// With effects.
    pub after_percent: f64,
}

/// What to diagnose.
pub struct Request<'a> {
    /// The description, with a table `[balance]`.
    pub machine: &'a Machine,
    /// Recordings to fit.
    pub fit: &'a [PathBuf],
    /// Recordings to report on; a third of each fitted one where empty.
    pub validate: &'a [PathBuf],
    /// The drive is judged below this [Hz].
    pub cutoff_hz: f64,
    /// Where the improved description goes.
    pub machine_out: Option<&'a Path>,
}

/// Closes the loop: finds what the balance lacks, and reports the error before and after.
///
/// # Errors
/// When the recordings cannot be read or say too little.
pub fn diagnose(
    request: &Request<'_>,
    progress: impl Fn(f64) + Sync,
) -> Result<Diagnosis, BalanceError> {
    let machine = request.machine;
    let balance = machine
        .balance
        .as_ref()
        .ok_or_else(|| BalanceError::NoBalance(machine.path.clone()))?;
    let read = |paths: &[PathBuf]| -> Result<Vec<Motion>, BalanceError> {
        paths
            .iter()
            .map(|path| Motion::read(machine, balance, path, request.cutoff_hz))
            .collect()
    };
    let (fitted, validation) = if request.validate.is_empty() {
        held_out(read(request.fit)?)
    } else {
        (read(request.fit)?, read(request.validate)?)
    };
    let (table, judge) = (Table::new(&fitted), Table::new(&validation));
    enough(&fitted, &table, balance)?;
    enough_to_judge(&judge)?;

    let linear = design::linear(&fitted);
    let described = described(balance, &fitted)?;
    let mut base = Columns::default();
    base.push(&linear, &vec![LINEAR_PRIOR; linear.len()]);
    for (_, columns) in &described {
        base.push(columns, &shared(columns.len(), LINEAR_PRIOR));
    }
    let scale = Scale::new(&fitted, request.cutoff_hz);
    let selection = Selection::find(
        &fitted,
        &table,
        &table.drive,
        base.clone(),
        &scale,
        progress,
    );
    let outcome = Outcome::new(
        balance,
        &selection,
        &base,
        (&fitted, &table),
        (&validation, &judge),
    )?;

    let machine_out = request.machine_out.map(Path::to_owned);
    if let Some(path) = &machine_out {
        description::write(machine, &outcome.linear, &outcome.effects, path)?;
    }
    Ok(outcome.diagnosis(request, machine_out, &selection, balance))
}

/// The last third of each recording is left out; of positions held, each third;
/// of recordings at steady speed, each third.
fn held_out(motions: Vec<Motion>) -> (Vec<Motion>, Vec<Motion>) {
    if motions.first().is_some_and(|m| m.regime == Regime::Steady) {
        let (mut fit, mut rest) = (Vec::new(), Vec::new());
        for (i, motion) in motions.into_iter().enumerate() {
            if i % 3 == 1 { &mut rest } else { &mut fit }.push(motion);
        }
        (fit, rest)
    } else {
        motions.into_iter().map(Motion::split).unzip()
    }
}

fn enough(motions: &[Motion], table: &Table, balance: &Balance) -> Result<(), BalanceError> {
    let (what, found, allowed) = match balance.regime {
        Regime::Steady => (
            "recordings at steady speed to fit",
            motions.len(),
            FEWEST_STEADY,
        ),
        _ => ("values below the cut-off to fit", table.len(), FEWEST),
    };
    if found < allowed {
        return Err(BalanceError::TooLittle {
            what,
            found,
            allowed,
        });
    }
    let first = table.drive[0];
    if table.drive.iter().all(|d| *d == first) {
        return Err(BalanceError::Constant(motions[0].path.clone()));
    }
    Ok(())
}

fn enough_to_judge(table: &Table) -> Result<(), BalanceError> {
    if table.len() < 3 {
        return Err(BalanceError::TooLittle {
            what: "values to validate on",
            found: table.len(),
            allowed: 3,
        });
    }
    Ok(())
}

/// The effects that the description has, each with its columns.
fn described(
    balance: &Balance,
    motions: &[Motion],
) -> Result<Vec<(Vec<f64>, Vec<Vec<f64>>)>, BalanceError> {
    Ok(balance
        .effects
        .iter()
        .filter_map(|e| Some((e, find(&e.name)?)))
        .map(|(e, effect)| {
            (
                e.coefficients.clone(),
                design::columns(motions, effect, &e.shape),
            )
        })
        .collect())
}

/// The effect called `name`.
fn find(name: &str) -> Option<&'static dyn Effect> {
    EFFECTS.iter().copied().find(|e| e.name() == name)
}

/// Whether an effect has the numbers that it needs.
///
/// # Errors
/// The field that has not, and what is allowed.
pub fn check_effect(effect: &BalanceEffect, loads: usize) -> Result<(), (&'static str, String)> {
    let Some(known) = find(&effect.name) else {
        return Ok(());
    };
    if effect.shape.len() != known.shape_length() {
        return Err(("shape", format!("{} values", known.shape_length())));
    }
    // A number of columns follows from the shape.
    if effect.shape.iter().any(|s| !s.is_finite() || s.abs() > 1e9) {
        return Err(("shape", "finite values".into()));
    }
    let terms = known.terms(&effect.shape, loads).len();
    if effect.coefficients.len() != terms {
        return Err(("coefficients", format!("{terms} values")));
    }
    Ok(())
}

/// Everything that was fitted, and its errors.
struct Outcome {
    linear: Linear,
    /// Those of the description, recalibrated, then those found.
    effects: Vec<BalanceEffect>,
    found: Vec<Vec<f64>>,
    error: Errors,
    validated: Vec<Validated>,
    remainder: Remainder,
}

impl Outcome {
    fn new(
        balance: &Balance,
        selection: &Selection<'_>,
        base: &Columns,
        (fitted, table): (&[Motion], &Table),
        (validation, judge): (&[Motion], &Table),
    ) -> Result<Self, BalanceError> {
        let rows = judge.len();
        let noise = selection.noise_variance();
        // The four models: coefficients on the recordings that are fitted ...
        let full = selection.fitted().coefficients;
        let plain = fit(base, &table.drive, table, noise).coefficients;
        let nominal = nominal_coefficients(balance);
        let known = base.times(&nominal, table.len());
        let rest: Vec<f64> = table.drive.iter().zip(&known).map(|(d, k)| d - k).collect();
        let mut found = Columns::default();
        for part in &selection.parts {
            found.push(&part.columns, &part.prior);
        }
        let on_nominal = fit(&found, &rest, table, noise).coefficients;
        // ... and their predictions on those that are not.
        let mut base_there = Columns::default();
        let linear = design::linear(validation);
        base_there.push(&linear, &vec![LINEAR_PRIOR; linear.len()]);
        for (_, columns) in described(balance, validation)? {
            base_there.push(&columns, &shared(columns.len(), LINEAR_PRIOR));
        }
        let mut found_there = Columns::default();
        for part in &selection.parts {
            found_there.push(
                &design::columns(validation, part.effect, &part.shape),
                &part.prior,
            );
        }
        let split = base.len();
        let residual = |base: &[f64], found: &[f64]| -> Vec<f64> {
            let a = base_there.times(base, rows);
            let b = found_there.times(found, rows);
            (0..rows).map(|i| judge.drive[i] - a[i] - b[i]).collect()
        };
        let none = vec![0.0; found_there.len()];
        let nominal_before = residual(&nominal, &none);
        let nominal_after = residual(&nominal, &on_nominal);
        let before = residual(&plain, &none);
        let after = residual(&full[..split], &full[split..]);
        let figure = |rest: &[f64]| figure(rest, judge);
        let error = Errors {
            nominal: BeforeAfter {
                before: figure(&nominal_before),
                after: figure(&nominal_after),
            },
            recalibrated: BeforeAfter {
                before: figure(&before),
                after: figure(&after),
            },
        };
        let validated = validation
            .iter()
            .enumerate()
            .map(|(k, motion)| {
                let of = |rest: &[f64]| {
                    let here = |x: &[f64]| -> f64 {
                        (0..rows)
                            .filter(|&i| judge.recording[i] == k)
                            .map(|i| x[i] * x[i])
                            .sum()
                    };
                    100.0 * (here(rest) / here(&judge.drive)).sqrt()
                };
                Validated {
                    recording: motion.path.clone(),
                    before_percent: of(&before),
                    after_percent: of(&after),
                }
            })
            .collect();
        let loads = balance.loads.len();
        let mut at = 3 + loads;
        let mut effects = Vec::new();
        for effect in &balance.effects {
            let n = effect.coefficients.len();
            effects.push(BalanceEffect {
                coefficients: full[at..at + n].to_vec(),
                ..effect.clone()
            });
            at += n;
        }
        let mut coefficients = Vec::new();
        for part in &selection.parts {
            let n = part.columns.len();
            coefficients.push(full[at..at + n].to_vec());
            effects.push(BalanceEffect {
                name: part.effect.name().into(),
                shape: part.shape.clone(),
                coefficients: full[at..at + n].to_vec(),
            });
            at += n;
        }
        let fitted_rest = selection.columns(None).times(&full, table.len());
        let fitted_rest: Vec<f64> = table
            .drive
            .iter()
            .zip(&fitted_rest)
            .map(|(d, e)| d - e)
            .collect();
        Ok(Self {
            linear: Linear {
                offset: full[0],
                inertia: full[1],
                drag: full[2],
                load_gains: full[3..3 + loads].to_vec(),
            },
            effects,
            found: coefficients,
            error,
            validated,
            remainder: Remainder::new(fitted, table, &fitted_rest),
        })
    }

    fn diagnosis(
        self,
        request: &Request<'_>,
        machine_out: Option<PathBuf>,
        selection: &Selection<'_>,
        balance: &Balance,
    ) -> Diagnosis {
        let effects: Vec<FoundEffect> = selection
            .parts
            .iter()
            .zip(self.found)
            .map(|(part, coefficients)| FoundEffect {
                name: part.effect.name(),
                channels: vec![balance.drive.name.clone()],
                parameters: Parameters {
                    shape: part.shape.clone(),
                    terms: part
                        .effect
                        .terms(&part.shape, balance.loads.len())
                        .into_iter()
                        .zip(coefficients)
                        .collect(),
                },
                evidence: FoundEvidence {
                    gain_percent: 100.0 * part.evidence.gain,
                    p_value: part.evidence.p_value,
                },
            })
            .collect();
        let alternatives: Vec<Alternative> = selection
            .parts
            .iter()
            .filter(|part| !part.alternatives.is_empty())
            .map(|part| Alternative {
                effect: part.effect.name(),
                instead: part.alternatives.clone(),
            })
            .collect();
        // The effect that explains most decides whether the finding is certain.
        let main = selection
            .parts
            .iter()
            .max_by(|a, b| a.evidence.gain.total_cmp(&b.evidence.gain));
        let verdict = match effects.len() {
            0 if self.remainder.percent > UNKNOWN_PERCENT && self.remainder.structured() => {
                "unknown"
            }
            0 => "none",
            _ if main.is_some_and(|m| !m.alternatives.is_empty()) => "inseparable",
            1 => "effect",
            _ => "effects",
        };
        let next_experiment = selection
            .parts
            .iter()
            .find(|part| !part.alternatives.is_empty())
            .map(|part| {
                format!(
                    "to tell {} from {}: {}",
                    part.effect.name(),
                    part.alternatives[0].0,
                    part.effect.shown_by()
                )
            });
        Diagnosis {
            verdict,
            effects,
            alternatives,
            next_experiment,
            error: self.error,
            recalibrated: self.linear,
            remainder: self.remainder,
            cutoff_hz: request.cutoff_hz,
            fitted_on: request.fit.to_vec(),
            validated_on: self.validated,
            machine_out,
        }
    }
}

/// The description's own coefficients, in the order of the columns.
fn nominal_coefficients(balance: &Balance) -> Vec<f64> {
    let mut c = vec![balance.offset, balance.inertia, balance.drag];
    c.extend(balance.loads.iter().map(|_| 1.0));
    c.extend(
        balance
            .effects
            .iter()
            .flat_map(|e| e.coefficients.iter().copied()),
    );
    c
}

/// RMS of a residual over that of the drive, with its interval by resampling
/// stretches with replacement.
fn figure(rest: &[f64], table: &Table) -> Figure {
    let stretches = table.stretch.iter().max().map_or(1, |s| s + 1);
    let mut sums = vec![(0.0, 0.0); stretches];
    for (i, r) in rest.iter().enumerate() {
        let sum = &mut sums[table.stretch[i]];
        sum.0 += r * r;
        sum.1 += table.drive[i] * table.drive[i];
    }
    let percent = |drawn: &mut dyn Iterator<Item = (f64, f64)>| {
        let (rest, drive) = drawn.fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        100.0 * (rest / drive).sqrt()
    };
    let value_percent = percent(&mut sums.iter().copied());
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut drawn: Vec<f64> = (0..RESAMPLES)
        .map(|_| percent(&mut (0..stretches).map(|_| sums[rng.random_range(0..stretches)])))
        .collect();
    drawn.sort_by(f64::total_cmp);
    Figure {
        value_percent,
        interval_percent: [drawn[RESAMPLES / 40], drawn[RESAMPLES - 1 - RESAMPLES / 40]],
    }
}
