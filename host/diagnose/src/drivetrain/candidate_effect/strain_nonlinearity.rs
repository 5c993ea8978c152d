//! Candidate effect: a gauge whose sensitivity changes in proportion to the torque, or to its
//! absolute value.

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, NonlinearParameter, Scope};
use crate::drivetrain::candidate_effect::{GaugeModel, each};
use crate::drivetrain::residual_signals::{
    DrivetrainResiduals, Regressor, ResidualSignal, product,
};

/// Torque, part of nominal, that counts as one way.
const BOTH_WAYS: f64 = 0.1;

/// `reading level g` or `reading |level| g`: a response that grows or falls with torque.
pub struct StrainNonlinearity;

const INFO: EffectInfo = EffectInfo {
    name: "strain-nonlinearity",
    description: "strain is not in proportion to torque",
    scope: Scope::PerSignal,
    linear: &[LinearParameter {
        name: "part of the reading at nominal torque",
        prior_std: 0.1,
    }],
    nonlinear: &[NonlinearParameter {
        name: "alike both ways",
        unit: "0 or 1",
        bounds: (0.0, 1.0),
        step: 0.0,
        logarithmic: false,
    }],
    recommended_experiment: "slow torque ramps through zero to both ends",
};

impl Effect<DrivetrainResiduals> for StrainNonlinearity {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn parameter_count(&self) -> usize {
        self.linear_parameters().len()
    }
    fn initial_values(&self, recording: &DrivetrainResiduals) -> Vec<Vec<f64>> {
        let level = &recording.signals.level;
        let reaches = |sign: f64| level.iter().any(|level| sign * level > BOTH_WAYS);
        if reaches(1.0) && reaches(-1.0) {
            each(&[0.0, 1.0])
        } else {
            each(&[0.0])
        }
    }
    /// Hardly any is a parabola.
    fn model_error(&self, _: &DrivetrainResiduals) -> f64 {
        0.25
    }
    fn regressors(&self, recording: &DrivetrainResiduals, shape: &[f64]) -> Vec<Regressor> {
        let level = recording.signals.level.iter();
        let level: Vec<f64> = if shape[0] == 0.0 {
            level.copied().collect()
        } else {
            level.map(|level| level.abs()).collect()
        };
        let column = |s: &ResidualSignal| product(&s.reading, &level);
        vec![Regressor::PerSignal(
            recording.residuals.iter().map(column).collect(),
        )]
    }
    fn apply_to(&self, shape: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        if shape[0] != 0.0 {
            return false;
        }
        gauge.nonlinearity += parameters[0];
        true
    }
}
