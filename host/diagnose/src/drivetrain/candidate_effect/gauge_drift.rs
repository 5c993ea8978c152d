//! Candidate effect: drift of a gauge's offset in proportion to time.

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, Scope};
use crate::drivetrain::candidate_effect::one_shape;
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Regressor};

/// `scale a (t - t0)`.
pub struct GaugeDrift;

const INFO: EffectInfo = EffectInfo {
    name: "gauge-drift",
    description: "a zero drifts with time",
    scope: Scope::PerSignal,
    linear: &[LinearParameter {
        name: "part of full scale per hour",
        prior_std: 10.0,
    }],
    nonlinear: &[],
    recommended_experiment: "standstill without load for as long as the recording",
};

impl Effect<DrivetrainResiduals> for GaugeDrift {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, _: &DrivetrainResiduals) -> Vec<Vec<f64>> {
        one_shape()
    }
    /// Hardly any drift is straight.
    fn model_error(&self, _: &DrivetrainResiduals) -> f64 {
        0.3
    }
    fn regressors(&self, recording: &DrivetrainResiduals, _: &[f64]) -> Vec<Regressor> {
        let t = &recording.signals.t;
        vec![Regressor::Offset(t.iter().map(|t| t / 3600.0).collect())]
    }
}
