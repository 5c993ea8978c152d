//! Defines `Diagnosable`, the interface of a machine kind to the diagnosis beyond its residual
//! model: reading with null samples, writing of the improved description, errors, JSON keys and
//! remarks.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use crate::candidate_effect::fitted::FittedEffect;
use crate::diagnosis::{DiagnoseError, Diagnosis, DiagnosisInput};
use crate::error_interval::LoadErrors;
use crate::residual_model::ResidualModel;
use crate::selection::stepwise::Selection;
use loadtwin_machine::Machine;

/// A machine kind that can be diagnosed.
pub trait Diagnosable: ResidualModel {
    /// Reads the recordings at `paths` and `validation`, and simulates the machine without effect.
    ///
    /// # Errors
    /// As [`crate::diagnose`].
    fn read(
        machine: &Machine,
        paths: &[PathBuf],
        validation: &[PathBuf],
        progress: impl Fn(f64),
    ) -> Result<DiagnosisInput<Self>, DiagnoseError>;

    /// Writes `machine` with the effects found to `path`; gives the names of those that the
    /// description has no place for.
    ///
    /// # Errors
    /// When a file cannot be read or written.
    fn write(
        machine: &Machine,
        diagnosis: &Diagnosis<Self>,
        path: &Path,
    ) -> Result<Vec<&'static str>, DiagnoseError>;

    /// Errors of `recordings` without and with the effects found.
    fn errors(recordings: &[Self], found: &[FittedEffect<Self>]) -> LoadErrors;

    /// Keys of the JSON that only this kind of machine has.
    fn extra_json(&self) -> Map<String, Value>;

    /// Limits of such a recording and their reasons, beside the effects that are not
    /// observable in it, and remarks on the description.
    fn remarks(&self, selection: &Selection<Self>) -> Option<String>;
}
