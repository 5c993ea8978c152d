//! Candidate effect, creep of a gauge: a slow response to a constant load. Regressor: the torque
//! after a first-order lag, whose time constant is found by search.

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, NonlinearParameter, Scope};
use crate::drivetrain::candidate_effect::{GaugeModel, each};
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Regressor};
use loadtwin_machine::{Creep, lag};

/// `scale a z`, `dz/dt = (level - z) / tau`.
pub struct GaugeCreep;

const INFO: EffectInfo = EffectInfo {
    name: "gauge-creep",
    description: "zeros creep with the history of the load",
    scope: Scope::PerSignal,
    linear: &[LinearParameter {
        name: "part of full scale in the end at nominal load",
        prior_std: 0.3,
    }],
    nonlinear: &[NonlinearParameter {
        name: "time constant",
        unit: "s",
        bounds: (2.0, 400.0),
        step: 0.35,
        logarithmic: true,
    }],
    recommended_experiment: "a long hold at nominal load and then a long one without load",
};

impl Effect<DrivetrainResiduals> for GaugeCreep {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, _: &DrivetrainResiduals) -> Vec<Vec<f64>> {
        each(&[3.0, 6.0, 12.0, 25.0, 50.0, 100.0])
    }
    /// Creep goes on over decades of time, of which one exponential is a part.
    fn model_error(&self, _: &DrivetrainResiduals) -> f64 {
        0.3
    }
    fn regressors(&self, recording: &DrivetrainResiduals, shape: &[f64]) -> Vec<Regressor> {
        let signals = &recording.signals;
        let level = signals.level.iter().copied();
        vec![Regressor::Offset(lag(level, signals.dt_s, shape[0]))]
    }
    fn apply_to(&self, shape: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        let is_new = gauge.creep.is_none();
        if is_new {
            gauge.creep = Some(Creep {
                at_nominal: parameters[0] * gauge.full_scale,
                time_s: shape[0],
            });
        }
        is_new
    }
}
