//! Candidate effect, sensor bias: a constant offset in the reading of a displacement sensor.

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, Scope};
use crate::residual_model::SignalSet;
use crate::rotor::{RotorResiduals, RotorTarget};

/// `b`: a constant in each reading.
pub struct SensorBias;

const INFO: EffectInfo = EffectInfo {
    name: "sensor-bias",
    description: "a sensor reads something where the shaft rests on its axis",
    scope: Scope::PerSignal,
    linear: &[LinearParameter {
        name: "offset [m]",
        prior_std: 1e-4,
    }],
    nonlinear: &[],
    recommended_experiment: "the rotor at rest, then turning",
};

impl Effect<RotorResiduals> for SensorBias {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, _: &RotorResiduals) -> Vec<Vec<f64>> {
        vec![Vec::new()]
    }
    fn regressors(&self, recording: &RotorResiduals, _: &[f64]) -> Vec<SignalSet> {
        vec![recording.each(|_, _| 1.0)]
    }
    /// A constant; but it may settle: a tenth of it, over half a recording, has this residual.
    fn model_error(&self, _: &RotorResiduals) -> f64 {
        0.03
    }
    fn apply_to(&self, _: &[f64], parameters: &[f64], target: &mut RotorTarget) -> bool {
        if let Some(channel) = target.channel() {
            channel.offset += channel.unit.from_si(parameters[0]);
        }
        true
    }
}
