//! Candidate effect, unequal load sharing between planets: the sensitivity of a gauge under passing
//! planets varies with the cosine and sine of the carrier angle. Regressors: these times its
//! predicted reading. Only for gauges whose strain map has narrow peaks.

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, Scope};
use crate::drivetrain::candidate_effect::order_regressors::fourier_pair;
use crate::drivetrain::candidate_effect::{GaugeModel, one_shape};
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Regressor, ResidualSignal};

/// `reading (a cos(angle) + b sin(angle))` where the map is made of planets passing.
pub struct PlanetSharing;

const INFO: EffectInfo = EffectInfo {
    name: "planet-sharing",
    description: "the planets carry unequal parts",
    scope: Scope::PerSignal,
    linear: &[
        LinearParameter {
            name: "cosine, part of the reading",
            prior_std: 0.1,
        },
        LinearParameter {
            name: "sine, part of the reading",
            prior_std: 0.1,
        },
    ],
    nonlinear: &[],
    recommended_experiment: "constant torque over many turns of the carrier",
};

impl Effect<DrivetrainResiduals> for PlanetSharing {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, _: &DrivetrainResiduals) -> Vec<Vec<f64>> {
        one_shape()
    }
    fn applies_to(&self, signal: &ResidualSignal) -> bool {
        signal.over_angle() && is_intermittent(&signal.map)
    }
    fn regressors(&self, recording: &DrivetrainResiduals, _: &[f64]) -> Vec<Regressor> {
        fourier_pair(recording, 1.0).map(Regressor::Gain).into()
    }
    fn apply_to(&self, _: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        gauge.over_angle(|m, angle| {
            m * (1.0 + parameters[0] * angle.cos() + parameters[1] * angle.sin())
        });
        true
    }
}

/// Whether a map is made of narrow peaks, as under passing planets.
fn is_intermittent(map: &[f64]) -> bool {
    let square = map.iter().map(|m| m * m).sum::<f64>() / map.len().max(1) as f64;
    let peak = map.iter().fold(0.0_f64, |peak, m| peak.max(m.abs()));
    peak > 2.0 * square.sqrt()
}
