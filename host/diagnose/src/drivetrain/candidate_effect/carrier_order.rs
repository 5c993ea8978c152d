//! Candidate effect, carrier order: a cosine and sine of one order of the carrier angle that the
//! strain map lacks, in proportion to torque.

use crate::candidate_effect::{Effect, EffectInfo, NonlinearParameter, Scope};
use crate::drivetrain::candidate_effect::GaugeModel;
use crate::drivetrain::candidate_effect::order_regressors::{AMPLITUDES, HIGHEST, fourier_pair};
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Regressor, product};

/// `scale level (a cos(k angle) + b sin(k angle))`.
pub struct CarrierOrder;

const INFO: EffectInfo = EffectInfo {
    name: "carrier-order",
    description: "an order of the carrier angle that the maps lack",
    scope: Scope::PerSignal,
    linear: AMPLITUDES,
    nonlinear: &[NonlinearParameter {
        name: "order",
        unit: "per turn of the carrier",
        bounds: (1.0, HIGHEST as f64),
        step: 0.0,
        logarithmic: false,
    }],
    recommended_experiment: "constant torque over many turns of the carrier",
};

impl Effect<DrivetrainResiduals> for CarrierOrder {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, _: &DrivetrainResiduals) -> Vec<Vec<f64>> {
        (1..=HIGHEST).map(|k| vec![k as f64]).collect()
    }
    fn regressors(&self, recording: &DrivetrainResiduals, shape: &[f64]) -> Vec<Regressor> {
        let level = &recording.signals.level;
        fourier_pair(recording, shape[0])
            .map(|wave| Regressor::Offset(product(&wave, level)))
            .into()
    }
    fn apply_to(&self, shape: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        let (full, order) = (gauge.rms(), shape[0]);
        gauge.over_angle(|m, angle| {
            m + full
                * (parameters[0] * (order * angle).cos() + parameters[1] * (order * angle).sin())
        });
        true
    }
}
