//! Diagnoses a drive: identifies the effects that its balance of torque or force lacks, by
//! regression on recordings. Here: request, error type, sequence, and the check of the effects that
//! a description lists.
//!
//! `drive = offset + inertia a + drag v + sum_j gain_j load_j + effects + rest`.
//! The linear part is what a description starts with; each effect is a physical
//! term with a few parameters ([`candidate_effect`]). Effects are added one by one where
//! they predict what took no part in the fit, and the result is reported on data that took no
//! part at all: the recordings for validation, or a held-out third of the data without these.
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::unreachable,
        clippy::todo,
        clippy::unimplemented
    )
)]

pub mod candidate_effect;
mod design_matrix;
mod diagnosis_result;
mod effect_evaluation;
mod gaussian_smoother;
mod improved_description;
mod least_squares;
mod noise_levels;
mod outliers;
mod remaining_residual;
mod report_page;
mod shape_parameter_std;
mod significance;
mod smoothed_motion;
mod stepwise;

use std::path::{Path, PathBuf};

use thiserror::Error;

pub use crate::candidate_effect::EFFECTS;
pub use crate::diagnosis_result::{
    Alternative, BeforeAfter, Beyond, Diagnosis, Errors, Figure, FoundEffect, FoundEvidence,
    Linear, Parameters, Residuals, Validated,
};
pub use crate::remaining_residual::Remainder;
pub use crate::report_page::page;

use crate::candidate_effect::{Effect, Scale};
use crate::design_matrix::{Dataset, OFFSET_PRIOR};
use crate::effect_evaluation::Outcome;
use crate::least_squares::{Columns, shared};
use crate::noise_levels::Levels;
use crate::smoothed_motion::Motion;
use crate::stepwise::{LINEAR_PRIOR, Selection};
use loadtwin_machine::{Balance, BalanceEffect, Machine, MachineError, Regime, Violation};
use loadtwin_recording::RecordingError;

/// Fewest decimated values that a diagnosis rests on.
const FEWEST: usize = 60;

/// Fewest recordings at steady speed.
const FEWEST_STEADY: usize = 8;

/// Why a balance cannot be diagnosed.
#[derive(Debug, Error)]
pub enum BalanceError {
    /// The description has no table `[balance]`.
    #[error("{}: no table [balance], which says what drives and what moves", .0.display())]
    NoBalance(PathBuf),
    /// An effect of the description is not one that a drive can have.
    #[error(transparent)]
    Machine(#[from] MachineError),
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

/// What to diagnose.
pub struct Request<'a> {
    /// The description, with a table `[balance]`.
    pub machine: &'a Machine,
    /// Recordings to fit.
    pub fit: &'a [PathBuf],
    /// Recordings to report on; a third of each fitted one where empty.
    pub validate: &'a [PathBuf],
    /// The balance is evaluated below this (Hz).
    pub cutoff_hz: f64,
    /// Where the improved description goes.
    pub machine_out: Option<&'a Path>,
}

/// Finds the effects that the balance lacks, and reports the error before and after.
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
    check_effects(machine)?;
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
    let (table, held_out) = (Dataset::new(&fitted), Dataset::new(&validation));
    enough(&fitted, &table, balance)?;
    check_length(&held_out)?;

    let base = base(balance, &fitted);
    let scale = Scale::new(&fitted, request.cutoff_hz);
    let find = |base| Selection::find(&fitted, &table, base, &scale, &progress);
    let alike = find(base.clone());
    // What differs between recordings is what operating points are there for, and
    // is fitted as such; unless that explains nothing: sensors may not have been zeroed.
    let offsets = design_matrix::offsets(&fitted, &table);
    let selection = if alike.parts.is_empty() && !offsets.is_empty() {
        let own = vec![OFFSET_PRIOR; offsets.len()];
        find(base.with(&offsets, &own))
    } else {
        alike
    };
    let outcome = Outcome::new(
        balance,
        &selection,
        &base,
        (&fitted, &table),
        (&validation, &held_out),
    );

    let machine_out = request.machine_out.map(Path::to_owned);
    if let Some(path) = &machine_out {
        let levels = Levels {
            nominal: rms(&table.drive),
            model_std: outcome.model_std,
            noise: noise_levels::noise(&fitted),
        };
        improved_description::write(machine, &outcome.linear, &outcome.effects, &levels, path)?;
    }
    Ok(outcome.diagnosis(request, machine_out, &selection, balance))
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|x| x * x).sum::<f64>() / values.len() as f64).sqrt()
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

fn enough(motions: &[Motion], table: &Dataset, balance: &Balance) -> Result<(), BalanceError> {
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

fn check_length(table: &Dataset) -> Result<(), BalanceError> {
    if table.len() < 3 {
        return Err(BalanceError::TooLittle {
            what: "values to validate on",
            found: table.len(),
            allowed: 3,
        });
    }
    Ok(())
}

/// The linear model's columns and those of the effects that the description has.
fn base(balance: &Balance, motions: &[Motion]) -> Columns {
    let mut base = Columns::default();
    let linear = design_matrix::linear(motions);
    base.push(&linear, &vec![LINEAR_PRIOR; linear.len()]);
    for known in &balance.effects {
        if let Some(effect) = find(&known.name) {
            let columns = design_matrix::columns(motions, effect, &known.shape);
            base.push(&columns, &shared(columns.len(), LINEAR_PRIOR));
        }
    }
    base
}

/// The effect called `name`.
fn find(name: &str) -> Option<&'static dyn Effect> {
    EFFECTS.iter().copied().find(|e| e.name() == name)
}

/// Checks the effects that a description lists: names, and numbers of values.
///
/// # Errors
/// The field that is out of its range, with its line in the file.
pub fn check_effects(machine: &Machine) -> Result<(), MachineError> {
    let Some(balance) = &machine.balance else {
        return Ok(());
    };
    for (i, effect) in balance.effects.iter().enumerate() {
        let refused = |part: &str, found: String, allowed: String| {
            machine.refused(Violation {
                field: format!("balance.effect[{}].{part}", i + 1),
                found,
                allowed,
            })
        };
        if find(&effect.name).is_none() {
            let known: Vec<&str> = EFFECTS.iter().map(|e| e.name()).collect();
            return Err(refused(
                "name",
                format!("{:?}", effect.name),
                known.join(", "),
            ));
        }
        check_effect(effect, balance.loads.len())
            .map_err(|(part, allowed)| refused(part, "another number of values".into(), allowed))?;
    }
    Ok(())
}

/// Whether an effect has the numbers that it needs; else the field that has not,
/// and what is allowed.
fn check_effect(effect: &BalanceEffect, loads: usize) -> Result<(), (&'static str, String)> {
    let Some(known) = find(&effect.name) else {
        return Ok(());
    };
    if effect.shape.len() != known.shape_parameters().len() {
        return Err((
            "shape",
            format!("{} values", known.shape_parameters().len()),
        ));
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
