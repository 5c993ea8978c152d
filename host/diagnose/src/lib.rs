//! `loadtwin diagnose`: identification of the physical effects that the model of a machine lacks,
//! from the residuals of recordings.
//!
//! ```text
//! recordings -> residuals -> candidates: regressors -> cross-validated log-evidence
//!               null samples of the same machine ----> thresholds
//!            -> stepwise selection -> hold-out -> residual tests -> verdict -> report, description
//! ```
//!
//! A machine kind gives residuals, regressors and null samples ([`Diagnosable`]). Regression, selection
//! and assessment know no machine. `loadtwin identify` ([`identify`]) fits the parameters of a drivetrain to the
//! same residuals.
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

mod assessment;
mod bearing;
pub mod candidate_effect;
mod diagnosable;
mod diagnosis;
mod diagnosis_report;
mod drivetrain;
mod error_interval;
mod filter_check;
mod filter_contradiction;
mod filter_run;
mod identification;
mod null_samples;
mod regression;
mod residual_model;
mod rotor;
mod sample_statistics;
mod selection;
mod smoothing;

use std::path::PathBuf;

use filter_contradiction::set_contradicted_aside;
use loadtwin_machine::Machine;

pub use assessment::empirical_correction::Correction;
pub use assessment::innovation_consistency::{Innovations, SensorInnovations, innovations};
pub use assessment::residual_excess::{ResidualExcess, residual_excesses};
pub use assessment::residual_tests::{ResidualTests, Test, TestResult, residual_tests};
pub use assessment::verdict::{Verdict, by_name, cannot_show};
pub use bearing::BearingResiduals;
pub use candidate_effect::fitted::FittedEffect;
pub use diagnosable::Diagnosable;
pub use diagnosis::{DiagnoseError, Diagnosis, DiagnosisInput};
pub use diagnosis_report::html_page::{headline, page};
pub use diagnosis_report::json::report;
pub use drivetrain::decimated_signals::Signals;
pub use drivetrain::improved_description::corrected;
pub use drivetrain::load_error::load_errors;
pub use drivetrain::residual_reader::read_residuals;
pub use drivetrain::residual_signals::{
    DrivetrainResiduals, Kind, Regressor, ResidualSignal, TorqueSource,
};
pub use error_interval::{Interval, LoadErrors};
pub use filter_check::{Evaluated, FilterCheck, check_filter};
pub use identification::{
    Combination, Gain, Identification, Identified, Parameter, Quantity, SensorError, Shown,
    identify, write_identified,
};
pub use residual_model::{Covariate, ResidualModel, Shaft};
pub use rotor::RotorResiduals;
pub use selection::candidates::RankedCandidate;
pub use selection::relevance::RELEVANT_PART;
pub use selection::stepwise::Selection;

/// Diagnoses `machine` on the recordings at `paths` with the library of its kind;
/// errors are reported on `validation`, or, where there is none, on the fitted
/// recordings themselves.
///
/// # Errors
/// [`DiagnoseError`] when the machine has no residuals, or a recording cannot
/// be read or says too little.
pub fn diagnose<S: Diagnosable>(
    machine: &Machine,
    paths: &[PathBuf],
    validation: &[PathBuf],
    progress: impl Fn(f64),
) -> Result<Diagnosis<S>, DiagnoseError> {
    diagnose_above(machine, paths, validation, RELEVANT_PART, progress)
}

/// As [`diagnose`], with effects negligible below `relevant_part` of the nominal load.
///
/// # Errors
/// As [`diagnose`].
pub fn diagnose_above<S: Diagnosable>(
    machine: &Machine,
    paths: &[PathBuf],
    validation: &[PathBuf],
    relevant_part: f64,
    progress: impl Fn(f64),
) -> Result<Diagnosis<S>, DiagnoseError> {
    let mut residuals = S::read(machine, paths, validation, |part| {
        progress(0.5 * part);
    })?;
    residuals.relevant_part = relevant_part;
    let diagnosis = residuals.diagnose(S::library(), |part| progress(0.5 + 0.45 * part));
    let diagnosis = set_contradicted_aside(machine, paths, &residuals, diagnosis)?;
    progress(1.0);
    Ok(diagnosis)
}
