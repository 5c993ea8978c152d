//! Candidate effect, shaft order: an oscillation of strain in proportion to torque, once or twice
//! per revolution of a shaft other than the carrier.

use crate::candidate_effect::{Effect, EffectInfo, NonlinearParameter, Scope};
use crate::drivetrain::candidate_effect::each;
use crate::drivetrain::candidate_effect::order_regressors::{AMPLITUDES, HIGHEST, fourier_pair};
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Regressor, product};

/// `scale level (a cos(r angle) + b sin(r angle))` with the speed ratio `r` of
/// another inertia: what comes once a turn of its shaft.
pub struct ShaftOrder;

const INFO: EffectInfo = EffectInfo {
    name: "shaft-order",
    description: "what comes once or twice a turn of another shaft",
    scope: Scope::PerSignal,
    linear: AMPLITUDES,
    nonlinear: &[NonlinearParameter {
        name: "order",
        unit: "per turn of the carrier",
        bounds: (0.0, f64::INFINITY),
        step: 0.0,
        logarithmic: false,
    }],
    recommended_experiment: "constant torque at two speeds",
};

impl Effect<DrivetrainResiduals> for ShaftOrder {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, recording: &DrivetrainResiduals) -> Vec<Vec<f64>> {
        // An order is only observable where it is sampled more than twice a period.
        let most = std::f64::consts::PI / recording.signals.dt_s / recording.signals.nominal_speed;
        let of_carrier = |r: f64| r.fract() == 0.0 && r <= HIGHEST as f64;
        let orders: Vec<f64> = recording
            .signals
            .ratios
            .iter()
            .flat_map(|r| [r.abs(), 2.0 * r.abs()])
            .filter(|r| !of_carrier(*r) && *r < 0.8 * most)
            .collect();
        each(&orders)
    }
    fn regressors(&self, recording: &DrivetrainResiduals, shape: &[f64]) -> Vec<Regressor> {
        let level = &recording.signals.level;
        fourier_pair(recording, shape[0])
            .map(|wave| Regressor::Offset(product(&wave, level)))
            .into()
    }
}
