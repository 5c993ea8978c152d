//! Candidate effect, gain error: a gauge responds more or less than described, in proportion.
//! Regressor: its predicted reading.

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, Scope};
use crate::drivetrain::candidate_effect::{GaugeModel, one_shape};
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Regressor};

/// `reading g`: gauge factor, lead resistance.
pub struct GainError;

const INFO: EffectInfo = EffectInfo {
    name: "gain-error",
    description: "a channel responds more or less than described",
    scope: Scope::PerSignal,
    linear: &[LinearParameter {
        name: "part of the reading",
        prior_std: 0.1,
    }],
    nonlinear: &[],
    recommended_experiment: "torque ramps between no load and nominal load at constant speed",
};

impl Effect<DrivetrainResiduals> for GainError {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, _: &DrivetrainResiduals) -> Vec<Vec<f64>> {
        one_shape()
    }
    fn regressors(&self, recording: &DrivetrainResiduals, _: &[f64]) -> Vec<Regressor> {
        vec![Regressor::Gain(vec![1.0; recording.signals.len()])]
    }
    fn apply_to(&self, _: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        gauge.map.iter_mut().for_each(|m| *m *= 1.0 + parameters[0]);
        true
    }
}
