//! Defines `ResidualModel`, the interface by which the diagnosis reads a recording of any machine
//! kind: residual signals with their noise, nuisance parameters with their priors, the effects to
//! try and their regressor columns, hold-out blocks, covariates, shaft angles.

use std::borrow::Cow;

use crate::candidate_effect::Effect;

/// A quantity that residuals are tested and plotted against.
pub struct Covariate<'a> {
    /// Its name.
    pub quantity: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Sample by sample.
    pub values: Cow<'a, [f64]>,
}

impl<'a> Covariate<'a> {
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
    pub std_between_recordings: f64,
}

impl Nuisance {
    /// With one coefficient in all recordings.
    pub fn shared(column: Vec<f64>, std: f64) -> Self {
        Self::per_recording(column, std, 0.0)
    }

    /// With a coefficient that differs by `std_between_recordings` from recording to recording.
    pub fn per_recording(column: Vec<f64>, std: f64, std_between_recordings: f64) -> Self {
        Self {
            column,
            std,
            std_between_recordings,
        }
    }
}

/// The angle that a shaft has turned by.
pub struct Shaft<'a> {
    /// Its name.
    pub name: &'a str,
    /// Angle, continuous over turns (rad).
    pub angle: Cow<'a, [f64]>,
}

/// What all `recordings` have of each quantity: `[quantity][recording]`.
pub fn common_covariates<S: ResidualModel>(recordings: &[S]) -> Vec<Vec<Covariate<'_>>> {
    let mut along: Vec<Vec<Covariate<'_>>> = Vec::new();
    for covariate in recordings.iter().flat_map(S::covariates) {
        match (along.iter_mut()).find(|of| of[0].quantity == covariate.quantity) {
            Some(of) => of.push(covariate),
            None => along.push(vec![covariate]),
        }
    }
    along.retain(|of| of.len() == recordings.len());
    along
}

/// A recording of one kind of machine as residuals, a signal for each thing that is measured,
/// and what effects predict for them.
pub trait ResidualModel: Clone + Send + Sync + 'static {
    /// One signal, as effects see it.
    type ResidualSignal;
    /// A way in which an effect enters the residuals.
    type Regressor;
    /// The part of a description that an effect changes.
    type Target;

    /// Every effect that is tried on such a machine.
    fn library() -> &'static [&'static dyn Effect<Self>];

    /// Sample period (s).
    fn dt_s(&self) -> f64;

    /// Speed of the main shaft, sample by sample [rad/s].
    fn speed(&self) -> &[f64];

    /// Samples of the hold-out blocks: long against the correlation of the noise.
    fn block(&self) -> usize;

    /// The signals.
    fn residuals(&self) -> &[Self::ResidualSignal];

    /// Name of signal `k`.
    fn name(&self, k: usize) -> &str;

    /// Unit of signal `k`.
    fn unit(&self, k: usize) -> &'static str;

    /// Residual of signal `k`: measured less predicted; NaN where there is none.
    fn residual(&self, k: usize) -> &[f64];

    /// Residual of signal `k` of a fault-free machine on the same profile; empty where that is not
    /// known.
    fn fault_free(&self, k: usize) -> &[f64];

    /// Puts another residual in its place.
    fn set_residual(&mut self, k: usize, residual: Vec<f64>);

    /// Standard deviation of a sample of signal `k` that the description expects.
    fn noise_std(&self, k: usize) -> f64;

    /// What signal `k` reads at nominal load, root mean square; none where no load is nominal.
    fn full_scale(&self, _: usize) -> Option<f64> {
        None
    }

    /// Whether the torque of the residuals comes from other sensors than those tested.
    fn has_reference_torque(&self) -> bool {
        false
    }

    /// Samples of signal `k` per independent sample.
    fn samples_per_independent(&self, k: usize) -> f64;

    /// Prior standard deviation of the mean of signal `k`, which may differ from recording to
    /// recording, in its unit; infinite where it may be anything.
    fn zero_std(&self, _: usize) -> f64 {
        f64::INFINITY
    }

    /// Nuisance parameters of signal `k`, its offset first where it has one.
    fn nuisances(&self, k: usize) -> Vec<Nuisance>;

    /// Prediction of `effect`, linearised about `parameters` (`[signal]`), for each of
    /// its linear parameters.
    fn columns(
        &self,
        effect: &dyn Effect<Self>,
        shape: &[f64],
        parameters: &[Vec<f64>],
    ) -> Vec<Columns>;

    /// Nuisance parameters that `effect` brings, per signal and recording.
    fn nuisances_of(&self, _effect: &dyn Effect<Self>, _shape: &[f64]) -> Vec<Columns> {
        Vec::new()
    }

    /// Quantities that residuals are plotted over, time first.
    fn covariates(&self) -> Vec<Covariate<'_>>;

    /// The shafts whose orders residuals are looked at for, each speed once.
    fn shafts(&self) -> Vec<Shaft<'_>>;
}

/// Columns of one linear parameter, one for each signal; empty where it
/// predicts nothing.
pub type Columns = Vec<Vec<f64>>;

/// Readings or predictions of all signals: `[signal][sample]`.
pub type SignalSet = Vec<Vec<f64>>;
