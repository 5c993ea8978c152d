//! Interface of a candidate effect, a physical effect that a model may lack (`Effect`): names,
//! linear and nonlinear parameters, regressors, model error, change of the description, and
//! experiment that shows it.

pub mod fitted;

use crate::residual_model::ResidualModel;
use loadtwin_machine::Machine;

/// Whether an effect has its linear parameters in each residual signal or once for all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// Each signal has its own.
    PerSignal,
    /// One set says what happens in every signal.
    Machine,
}

/// A linear parameter.
#[derive(Clone, Copy, Debug)]
pub struct LinearParameter {
    /// Its name, with what it is a part of.
    pub name: &'static str,
    /// Prior standard deviation, in the same unit.
    pub prior_std: f64,
}

/// A parameter that the residual is not linear in.
#[derive(Clone, Copy, Debug)]
pub struct NonlinearParameter {
    /// Its name.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Smallest and largest value.
    pub bounds: (f64, f64),
    /// First step of its refinement; 0 for one that only has the values of
    /// the grid.
    pub step: f64,
    /// Whether the step is a factor (of e).
    pub logarithmic: bool,
}

/// What an effect is: its names, parameters and the experiment that shows it best.
#[derive(Clone, Copy, Debug)]
pub struct EffectInfo {
    /// Name in verdicts.
    pub name: &'static str,
    /// Description in a few words.
    pub description: &'static str,
    /// Whether each residual signal has its own linear parameters.
    pub scope: Scope,
    /// Parameters that the residual is linear in.
    pub linear: &'static [LinearParameter],
    /// Parameters that are found by search.
    pub nonlinear: &'static [NonlinearParameter],
    /// The experiment that shows it best.
    pub recommended_experiment: &'static str,
}

/// A small piece of model that the machine description may lack.
///
/// The residual is `sum_j c_j term_j(shape)` with linear parameters `c`, found
/// by least squares, and a shape that is found by search.
pub trait Effect<S: ResidualModel>: Sync {
    /// What it is.
    fn info(&self) -> &EffectInfo;

    /// Name in verdicts.
    fn name(&self) -> &'static str {
        self.info().name
    }

    /// Description in a few words.
    fn description(&self) -> &'static str {
        self.info().description
    }

    /// Where its parameters apply.
    fn scope(&self) -> Scope {
        self.info().scope
    }

    /// The linear parameters.
    fn linear_parameters(&self) -> &'static [LinearParameter] {
        self.info().linear
    }

    /// The nonlinear parameters.
    fn nonlinear_parameters(&self) -> &'static [NonlinearParameter] {
        self.info().nonlinear
    }

    /// The experiment that shows it best.
    fn recommended_experiment(&self) -> &'static str {
        self.info().recommended_experiment
    }

    /// How many numbers it may choose: what explains the same with fewer is the simpler one.
    fn parameter_count(&self) -> usize {
        self.linear_parameters().len() + self.nonlinear_parameters().len()
    }

    /// Shapes from which the search starts; none where the recording cannot
    /// show the effect.
    fn initial_values(&self, recording: &S) -> Vec<Vec<f64>>;

    /// One term for each linear parameter.
    fn regressors(&self, recording: &S, shape: &[f64]) -> Vec<S::Regressor>;

    /// Whether the terms stay the same however large the parameters are.
    fn is_linear(&self) -> bool {
        true
    }

    /// Terms with which `sum_j c_j term_j` is what it predicts at these
    /// parameters (`[signal]`, empty where it does not act), and nearly so
    /// around them.
    fn regressors_at(&self, recording: &S, shape: &[f64], _: &[Vec<f64>]) -> Vec<S::Regressor> {
        self.regressors(recording, shape)
    }

    /// Nuisance parameters that it brings to each signal, as one standard deviation: a changed
    /// chain begins with other vibrations.
    fn own_nuisances(&self, _: &S, _shape: &[f64]) -> Vec<S::Regressor> {
        Vec::new()
    }

    /// Relative model error, in amplitude, of what it explains: a residual of that size
    /// is no further effect.
    fn model_error(&self, _: &S) -> f64 {
        0.15
    }

    /// Where in the machine this shape is, in words.
    fn location(&self, _: &S, _shape: &[f64]) -> Option<String> {
        None
    }

    /// Which signals it can act on.
    fn applies_to(&self, _: &S::ResidualSignal) -> bool {
        true
    }

    /// Whether it is large enough to matter, whatever its part of the nominal load.
    fn is_relevant(&self, _: &S, _shape: &[f64], _parameters: &[Vec<f64>]) -> bool {
        true
    }

    /// Natural logarithm of the odds for it by a signal's faulty samples
    /// alone.
    fn fault_log_odds(&self, _: &S::ResidualSignal) -> f64 {
        0.0
    }

    /// Whether its parameters are those of the machine, and not of one recording.
    fn is_machine_property(&self) -> bool {
        true
    }

    /// Latent degrees of freedom that its terms took from the data.
    fn free_degrees(&self, _: &S) -> f64 {
        0.0
    }

    /// Writes its parameters into the description, so that the estimator runs it; false where that
    /// has no place for it.
    fn apply_to(&self, _shape: &[f64], _parameters: &[f64], _place: &mut S::Target) -> bool {
        false
    }

    /// The same, for parts of the description that belong to no single channel.
    fn apply_to_machine(
        &self,
        _: &S,
        _shape: &[f64],
        _parameters: &[f64],
        _machine: &mut Machine,
    ) -> bool {
        false
    }
}
