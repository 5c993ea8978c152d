//! Candidate effect, torque ripple (cogging): a torque on one inertia that depends on the angle,
//! cosine and sine of one order per turn of the main shaft. Inertia and order are found by search.

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, NonlinearParameter, Scope};
use crate::drivetrain::candidate_effect::order_regressors::fourier_pair;
use crate::drivetrain::residual_signals::{
    DrivetrainResiduals, Kind, Regressor, ResidualSignal, product,
};

/// `a cos(k angle) + b sin(k angle)` on one inertia: cogging.
pub struct TorqueRipple;

const INFO: EffectInfo = EffectInfo {
    name: "torque-ripple",
    description: "a torque that depends on the angle (cogging)",
    scope: Scope::Machine,
    linear: &[
        LinearParameter {
            name: "cosine, part of nominal torque",
            prior_std: 0.05,
        },
        LinearParameter {
            name: "sine, part of nominal torque",
            prior_std: 0.05,
        },
    ],
    nonlinear: &[
        NonlinearParameter {
            name: "inertia",
            unit: "number",
            bounds: (0.0, 6.0),
            step: 0.0,
            logarithmic: false,
        },
        NonlinearParameter {
            name: "order",
            unit: "per turn of the main shaft",
            bounds: (1.0, 48.0),
            step: 0.0,
            logarithmic: false,
        },
    ],
    recommended_experiment: "slow turning at constant speed without load over several turns",
};

impl Effect<DrivetrainResiduals> for TorqueRipple {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, recording: &DrivetrainResiduals) -> Vec<Vec<f64>> {
        if recording.signals.response.is_none() {
            return Vec::new();
        }
        let bodies = recording.signals.inertias.len();
        (0..bodies)
            .flat_map(|body| (1..=30).map(move |k| vec![body as f64, f64::from(k)]))
            .collect()
    }
    fn applies_to(&self, signal: &ResidualSignal) -> bool {
        signal.kind != Kind::Angle
    }
    fn regressors(&self, recording: &DrivetrainResiduals, shape: &[f64]) -> Vec<Regressor> {
        // What the chain does to a torque is known only as fast as it is sampled.
        let most = 0.8 * std::f64::consts::PI / recording.signals.dt_s;
        let resolved = |w: &f64| f64::from(u8::from((shape[1] * w).abs() < most));
        let resolved: Vec<f64> = recording.signals.speed.iter().map(resolved).collect();
        fourier_pair(recording, shape[1])
            .map(|u| Regressor::ResistingTorque {
                body: shape[0] as usize,
                u: product(&u, &resolved),
                sticks: false,
            })
            .into()
    }
}
