//! Candidate effect: gain error of one displacement sensor. Regressor: what it reads of the
//! unbalance that explains the readings best; the sensor is found by search.

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, NonlinearParameter, Scope};
use crate::residual_model::SignalSet;
use crate::rotor::candidate_effect::{RUN_UP, location_grid, location_parameter};
use crate::rotor::{RotorResiduals, RotorTarget};

/// `g y` in one sensor.
pub struct GainError;

const PLACE: &[NonlinearParameter] = &[location_parameter("channel", "from 0")];

const INFO: EffectInfo = EffectInfo {
    name: "gain-error",
    description: "a channel responds more or less than described",
    scope: Scope::Machine,
    linear: &[LinearParameter {
        name: "part of the reading",
        prior_std: 0.1,
    }],
    nonlinear: PLACE,
    recommended_experiment: RUN_UP,
};

impl Effect<RotorResiduals> for GainError {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, recording: &RotorResiduals) -> Vec<Vec<f64>> {
        location_grid(recording.channels().len())
    }
    fn regressors(&self, recording: &RotorResiduals, shape: &[f64]) -> Vec<SignalSet> {
        let channel = shape[0] as usize;
        vec![recording.each(|k, i| {
            if k == channel {
                recording.explained(k)[i]
            } else {
                0.0
            }
        })]
    }
    fn location(&self, recording: &RotorResiduals, shape: &[f64]) -> Option<String> {
        Some(recording.channels()[shape[0] as usize].name.clone())
    }
    fn apply_to(&self, shape: &[f64], parameters: &[f64], target: &mut RotorTarget) -> bool {
        if let Some(channel) = target.machine.channels.get_mut(shape[0] as usize) {
            let sensitivity = channel.sensitivity.unwrap_or(1.0);
            channel.sensitivity = Some(sensitivity * (1.0 + parameters[0]));
        }
        true
    }
}
