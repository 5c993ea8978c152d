//! What the judgement needs to know of a kind of machine.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use super::effect::Effect;
use super::error::LoadErrors;
use super::select::{Found, Selection};
use super::stream::Columns;
use super::{DiagnoseError, Diagnosis, Residuals};
use loadtwin_machine::Machine;

/// What residuals are drawn over.
pub struct Abscissa<'a> {
    /// Its name.
    pub quantity: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Sample by sample.
    pub values: Cow<'a, [f64]>,
}

impl<'a> Abscissa<'a> {
    /// `quantity` [`unit`] sample by sample.
    pub fn new(
        quantity: &'static str,
        unit: &'static str,
        values: impl Into<Cow<'a, [f64]>>,
    ) -> Self {
        Self {
            quantity,
            unit,
            values: values.into(),
        }
    }
}

/// A column that is in the model anyway.
pub struct Nuisance {
    /// The column.
    pub column: Vec<f64>,
    /// Standard deviation of its coefficient.
    pub std: f64,
    /// Standard deviation by which the coefficient differs from recording to recording; 0 of what
    /// is the machine's.
    pub spread: f64,
}

impl Nuisance {
    /// With one coefficient in all recordings.
    pub fn of_machine(column: Vec<f64>, std: f64) -> Self {
        Self::of_recording(column, std, 0.0)
    }

    /// With a coefficient that differs by `spread` from recording to recording.
    pub fn of_recording(column: Vec<f64>, std: f64, spread: f64) -> Self {
        Self {
            column,
            std,
            spread,
        }
    }
}

/// The angle that a shaft has turned by.
pub struct Shaft<'a> {
    /// Its name.
    pub name: &'a str,
    /// Angle, continuous over turns [rad].
    pub angle: Cow<'a, [f64]>,
}

/// What all `sessions` have of each quantity: `[quantity][session]`.
pub fn common<S: Observed>(sessions: &[S]) -> Vec<Vec<Abscissa<'_>>> {
    let mut along: Vec<Vec<Abscissa<'_>>> = Vec::new();
    for abscissa in sessions.iter().flat_map(S::abscissae) {
        match (along.iter_mut()).find(|of| of[0].quantity == abscissa.quantity) {
            Some(of) => of.push(abscissa),
            None => along.push(vec![abscissa]),
        }
    }
    along.retain(|of| of.len() == sessions.len());
    along
}

/// A recording of one kind of machine as residuals, a stream for each thing that is measured,
/// and what effects predict for them.
pub trait Observed: Clone + Send + Sync + 'static {
    /// One stream, as effects see it.
    type Stream;
    /// A way in which an effect enters the residuals.
    type Term;
    /// What of a description takes an effect.
    type Place;

    /// Every effect that is tried on such a machine.
    fn library() -> &'static [&'static dyn Effect<Self>];

    /// Reads `recordings` and `validation`, and simulates the machine without effect.
    ///
    /// # Errors
    /// As [`super::diagnose`].
    fn read(
        machine: &Machine,
        recordings: &[PathBuf],
        validation: &[PathBuf],
        progress: impl Fn(f64),
    ) -> Result<Residuals<Self>, DiagnoseError>;

    /// Writes `machine` with the effects found to `path`; gives the names of those that the
    /// line has no place for.
    ///
    /// # Errors
    /// When a file cannot be read or written.
    fn write(
        machine: &Machine,
        diagnosis: &Diagnosis<Self>,
        path: &Path,
    ) -> Result<Vec<&'static str>, DiagnoseError>;

    /// Errors of `sessions` without and with what was found.
    fn errors(sessions: &[Self], found: &[Found<Self>]) -> LoadErrors;

    /// Sample period [s].
    fn dt_s(&self) -> f64;

    /// Speed of the main shaft, sample by sample [rad/s].
    fn speed(&self) -> &[f64];

    /// Samples of the blocks that are left out: long against the correlation of the noise.
    fn block(&self) -> usize;

    /// The streams.
    fn streams(&self) -> &[Self::Stream];

    /// Name of stream `k`.
    fn name(&self, k: usize) -> &str;

    /// Unit of stream `k`.
    fn unit(&self, k: usize) -> &'static str;

    /// Residual of stream `k`: measured less predicted; NaN where there is none.
    fn residual(&self, k: usize) -> &[f64];

    /// What a clean machine leaves of stream `k` when it does the same; empty where that is not
    /// known.
    fn clean(&self, k: usize) -> &[f64];

    /// Puts another residual in its place.
    fn set_residual(&mut self, k: usize, residual: Vec<f64>);

    /// Standard deviation of a sample of stream `k` that the description expects.
    fn noise_std(&self, k: usize) -> f64;

    /// Whether what the residuals are taken from is told by other sensors than those judged.
    fn is_referred(&self) -> bool {
        false
    }

    /// Samples of stream `k` for one that tells something new.
    fn inflation(&self, k: usize) -> f64;

    /// How far the mean of stream `k` is known to be off from recording to recording.
    fn zero_std(&self, _: usize) -> f64 {
        f64::INFINITY
    }

    /// What is in the model of stream `k` anyway, its zero first where it has one.
    fn nuisances(&self, k: usize) -> Vec<Nuisance>;

    /// What `effect`, taken as linear about `parameters` (`[stream]`), predicts for each of
    /// its linear parameters.
    fn columns(
        &self,
        effect: &dyn Effect<Self>,
        shape: &[f64],
        parameters: &[Vec<f64>],
    ) -> Vec<Columns>;

    /// What may be beside `effect` in each stream by itself, differently in each recording.
    fn nuisances_of(&self, _effect: &dyn Effect<Self>, _shape: &[f64]) -> Vec<Columns> {
        Vec::new()
    }

    /// What residuals are drawn over, time first.
    fn abscissae(&self) -> Vec<Abscissa<'_>>;

    /// The shafts whose orders residuals are looked at for, each speed once.
    fn shafts(&self) -> Vec<Shaft<'_>>;

    /// Keys of the JSON that only this kind of machine has.
    fn particulars(&self) -> Map<String, Value>;

    /// What such a recording cannot tell, and why, beside the effects of which it
    /// shows nothing, and what it says of the description.
    fn note(&self, selection: &Selection<Self>) -> Option<String>;
}
