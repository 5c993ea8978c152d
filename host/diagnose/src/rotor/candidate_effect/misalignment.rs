//! Candidate effect, misalignment of a coupling: the response to forces of order 2, forward and
//! backward, at one end of the shaft.

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, NonlinearParameter, Scope};
use crate::residual_model::SignalSet;
use crate::rotor::RotorResiduals;
use crate::rotor::candidate_effect::location_grid;

/// What a force at an end of the shaft does twice a turn, forward and backward.
///
/// Source: Gibbons, Coupling misalignment forces, Proc. 5th Turbomachinery Symposium (1976).
pub struct Misalignment;

const fn newtons(name: &'static str) -> LinearParameter {
    LinearParameter {
        name,
        prior_std: 10.0,
    }
}

const ALL: &[LinearParameter] = &[
    newtons("forward, cosine [N]"),
    newtons("forward, sine [N]"),
    newtons("backward, cosine [N]"),
    newtons("backward, sine [N]"),
];

const INFO: EffectInfo = EffectInfo {
    name: "misalignment",
    description: "a coupling that is not in line pulls twice a turn",
    scope: Scope::Machine,
    linear: ALL,
    nonlinear: &[NonlinearParameter {
        name: "end",
        unit: "0 is left, 1 is right",
        bounds: (0.0, 1.0),
        step: 0.0,
        logarithmic: false,
    }],
    recommended_experiment: "constant speeds about half a critical one",
};

impl Effect<RotorResiduals> for Misalignment {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, _: &RotorResiduals) -> Vec<Vec<f64>> {
        location_grid(2)
    }
    fn regressors(&self, recording: &RotorResiduals, shape: &[f64]) -> Vec<SignalSet> {
        recording.second_order_response(shape[0] as usize).to_vec()
    }
    fn location(&self, _: &RotorResiduals, shape: &[f64]) -> Option<String> {
        Some(["left end", "right end"][shape[0] as usize].into())
    }
}
