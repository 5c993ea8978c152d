//! Candidate effect, gauge at another carrier angle than described: its strain map is shifted and
//! has another gain. Regressors: minus the slope of its predicted reading over the angle, and the
//! reading at the shifted angle.

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, Scope};
use crate::drivetrain::candidate_effect::{GaugeModel, one_shape};
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Regressor, ResidualSignal};

/// `(1 + g) reading(angle - s) - reading(angle)`: a gauge that sits elsewhere,
/// where the strain has another phase and another size.
pub struct GaugePosition;

const INFO: EffectInfo = EffectInfo {
    name: "gauge-position",
    description: "a gauge sits at another angle of the carrier",
    scope: Scope::PerSignal,
    linear: &[
        LinearParameter {
            name: "angle [rad]",
            prior_std: 0.02,
        },
        LinearParameter {
            name: "part of the reading",
            prior_std: 0.05,
        },
    ],
    nonlinear: &[],
    recommended_experiment: "constant torque over several turns of the carrier at two speeds",
};

impl Effect<DrivetrainResiduals> for GaugePosition {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, _: &DrivetrainResiduals) -> Vec<Vec<f64>> {
        one_shape()
    }
    fn applies_to(&self, signal: &ResidualSignal) -> bool {
        signal.over_angle()
    }
    fn is_linear(&self) -> bool {
        false
    }
    fn regressors(&self, recording: &DrivetrainResiduals, shape: &[f64]) -> Vec<Regressor> {
        self.regressors_at(recording, shape, &[])
    }
    fn regressors_at(
        &self,
        recording: &DrivetrainResiduals,
        _: &[f64],
        parameters: &[Vec<f64>],
    ) -> Vec<Regressor> {
        let (turned, larger) = recording
            .residuals
            .iter()
            .enumerate()
            .map(|(k, signal)| {
                let shift = parameters.get(k).and_then(|p| p.first()).copied();
                let shift = shift.unwrap_or(0.0);
                let secant = recording.secant(signal, |_| shift);
                let there = signal.reading.iter().zip(&secant);
                (
                    secant.iter().map(|v| -v).collect::<Vec<f64>>(),
                    there.map(|(r, v)| r - shift * v).collect::<Vec<f64>>(),
                )
            })
            .unzip();
        vec![Regressor::PerSignal(turned), Regressor::PerSignal(larger)]
    }
    fn apply_to(&self, _: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        let map = gauge.map.clone();
        let n = map.len();
        let turned = |angle: f64| {
            let position = (angle / std::f64::consts::TAU).rem_euclid(1.0) * n as f64;
            let left = position as usize % n;
            map[left] + position.fract() * (map[(left + 1) % n] - map[left])
        };
        if n > 1 {
            gauge.over_angle(|_, angle| (1.0 + parameters[1]) * turned(angle - parameters[0]));
        }
        true
    }
}
