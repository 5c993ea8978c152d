//! Candidate effect: hysteresis of a gauge's reading over the torque (Bouc-Wen model).

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, NonlinearParameter, Scope};
use crate::drivetrain::candidate_effect::{GaugeModel, each};
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Regressor};
use loadtwin_machine::Hysteresis;

/// Bouc-Wen in the strain: `scale a z`, `dz = (dl - |dl| z) / width` with the level `l`.
pub struct StrainHysteresis;

const INFO: EffectInfo = EffectInfo {
    name: "strain-hysteresis",
    description: "strain depends on the direction from which the load came",
    scope: Scope::PerSignal,
    linear: &[LinearParameter {
        name: "part of full scale, half the width of the loop",
        prior_std: 0.1,
    }],
    nonlinear: &[NonlinearParameter {
        name: "level over which it turns",
        unit: "part of nominal",
        bounds: (0.02, 1.0),
        step: 0.35,
        logarithmic: true,
    }],
    recommended_experiment: "torque cycles of several sizes, up and down",
};

impl Effect<DrivetrainResiduals> for StrainHysteresis {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, _: &DrivetrainResiduals) -> Vec<Vec<f64>> {
        each(&[0.05, 0.15, 0.4])
    }
    fn regressors(&self, recording: &DrivetrainResiduals, shape: &[f64]) -> Vec<Regressor> {
        let mut z: f64 = 0.0;
        let mut before = recording.signals.level.first().copied().unwrap_or(0.0);
        let column = |l: &f64| {
            let step = (l - before) / shape[0];
            before = *l;
            z = (z + step - step.abs() * z).clamp(-1.0, 1.0);
            z
        };
        vec![Regressor::Offset(
            recording.signals.level.iter().map(column).collect(),
        )]
    }
    fn apply_to(&self, shape: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        let is_new = gauge.hysteresis.is_none();
        if is_new {
            gauge.hysteresis = Some(Hysteresis {
                half_width: parameters[0] * gauge.full_scale,
                level: shape[0],
            });
        }
        is_new
    }
}
