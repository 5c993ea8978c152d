//! Candidate effect, shaft bow: the response to a force that rotates with the shaft and is the same
//! at every speed.

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, NonlinearParameter, Scope};
use crate::residual_model::SignalSet;
use crate::rotor::RotorResiduals;
use crate::rotor::candidate_effect::{RUN_UP, location_grid, location_parameter};

/// What a force that turns with the shaft and is the same at every speed does, at the node of a
/// load: a shaft that is bent as such a force would bend it.
///
/// Source: Nicholas, Gunter, Allaire, Effect of residual shaft bow on unbalance response,
/// J. Eng. Power 98 (1976).
pub struct ShaftBow;

const PLACE: &[NonlinearParameter] = &[location_parameter("load", "from 0")];

const INFO: EffectInfo = EffectInfo {
    name: "shaft-bow",
    description: "the shaft is bent where nothing acts on it",
    scope: Scope::Machine,
    linear: &[
        LinearParameter {
            name: "cosine of the force that would bend it so [N]",
            prior_std: 10.0,
        },
        LinearParameter {
            name: "sine of the force that would bend it so [N]",
            prior_std: 10.0,
        },
    ],
    nonlinear: PLACE,
    recommended_experiment: RUN_UP,
};

impl Effect<RotorResiduals> for ShaftBow {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, recording: &RotorResiduals) -> Vec<Vec<f64>> {
        location_grid(recording.rotor().loads.len())
    }
    fn regressors(&self, recording: &RotorResiduals, shape: &[f64]) -> Vec<SignalSet> {
        recording.bow_response(shape[0] as usize).to_vec()
    }
    fn location(&self, recording: &RotorResiduals, shape: &[f64]) -> Option<String> {
        let load = &recording.rotor().loads[shape[0] as usize];
        Some(format!("node {}", load.node))
    }
}
