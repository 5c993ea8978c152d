//! `FittedEffect`, a candidate effect after its fit: shape and linear parameters, evidence with
//! its threshold, and the effects and locations that the data do not distinguish from it.

use crate::candidate_effect::Effect;
use crate::residual_model::ResidualModel;

/// An effect with its parameters.
#[derive(Clone)]
pub struct FittedEffect<S: ResidualModel> {
    /// The effect.
    pub effect: &'static dyn Effect<S>,
    /// Its shape.
    pub shape: Vec<f64>,
    /// Linear parameters of each signal; empty where it does not act.
    pub parameters: Vec<Vec<f64>>,
    /// Logarithm of the evidence on left-out blocks.
    pub evidence: f64,
    /// What would have been evidence enough; none where chance always reaches it.
    pub threshold: Option<f64>,
    /// Evidence of each signal.
    pub per_signal: Vec<f64>,
    /// Overdispersion: scatter of a signal's estimate of shared parameters over the null samples, relative to
    /// its noise.
    pub overdispersion: Vec<f64>,
    /// Other shapes that explain the same.
    pub equivalent_locations: Vec<Vec<f64>>,
    /// Other effects that the data cannot distinguish from it, by name.
    pub indistinguishable_from: Vec<&'static str>,
}

impl<S: ResidualModel> FittedEffect<S> {
    /// Whether the data do not determine the effect or its location.
    pub fn is_ambiguous(&self) -> bool {
        !(self.equivalent_locations.is_empty() && self.indistinguishable_from.is_empty())
    }
}

/// Whether the regressors of `effect` are estimated from the residuals themselves, so that they may
/// explain anything.
pub(crate) fn is_free_signal<S: ResidualModel>(recordings: &[S], effect: &dyn Effect<S>) -> bool {
    recordings.iter().any(|s| effect.free_degrees(s) > 0.0)
}
