//! Candidate effect, backlash: lost motion in the mesh of a shaft. Regressor: change of the shaft
//! torques and twists in a simulation with the gap; where its loads are not all known, a jump of
//! the twist with the sign of the torque. Shaft and gap are found by search.

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, NonlinearParameter, Scope};
use crate::drivetrain::candidate_effect::friction::SETS_OFF;
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Regressor};

/// Which shaft an effect is in.
pub(crate) const SHAFT: NonlinearParameter = NonlinearParameter {
    name: "shaft",
    unit: "number",
    bounds: (0.0, 6.0),
    step: 0.0,
    logarithmic: false,
};

/// Level over which the flank changes where the chain's own response is not
/// known, part of nominal.
const FLANK: f64 = 0.005;

/// Lost motion: what the shafts carry with play in one of them, less what they
/// carry without; where their loads are not known, the twist that jumps by the
/// play as the torque changes its sign.
pub struct Backlash;

const INFO: EffectInfo = EffectInfo {
    name: "backlash",
    description: "a mesh has play: the twist jumps as torque changes its sign",
    scope: Scope::Machine,
    linear: &[LinearParameter {
        name: "part of what such a play does",
        prior_std: 1.0,
    }],
    nonlinear: &[
        SHAFT,
        NonlinearParameter {
            name: "play",
            unit: "part of the twist at nominal torque",
            bounds: (0.002, 2.0),
            step: 0.3,
            logarithmic: true,
        },
        SETS_OFF,
    ],
    recommended_experiment: "torque through zero both ways at low speed, with an encoder at both ends",
};

impl Effect<DrivetrainResiduals> for Backlash {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, recording: &DrivetrainResiduals) -> Vec<Vec<f64>> {
        // Fine: the play decides on the phase of what vibrates once the flank is met again; without that
        // vibration, coarse.
        let fine = (0..27).map(|i| [0.015 * 1.2_f64.powi(i), 1.0]);
        let coarse = (0..12).map(|i| [0.015 * 1.5_f64.powi(i), 0.0]);
        (0..recording.twist.len())
            .flat_map(|i| {
                let plays = fine.clone().chain(coarse.clone());
                plays.map(move |[play, sets_off]| vec![i as f64, play, sets_off])
            })
            .collect()
    }
    /// Whether the vibration is modelled is no number of the machine.
    fn parameter_count(&self) -> usize {
        INFO.linear.len() + INFO.nonlinear.len() - 1
    }
    fn regressors(&self, recording: &DrivetrainResiduals, shape: &[f64]) -> Vec<Regressor> {
        let (signals, shaft) = (&recording.signals, shape[0] as usize);
        let Some(response) = &signals.response else {
            let flank = |l: &f64| 0.5 * shape[1] * l / l.hypot(FLANK);
            return vec![Regressor::LostMotion {
                shaft,
                u: signals.level.iter().map(flank).collect(),
            }];
        };
        let play = shape[1] * recording.twist[shaft];
        let driven = response.driven.with_play(shaft, play, &response.carried);
        let mut change = driven.carried().difference(&response.carried);
        for torque in &mut change.torque {
            if shape[2] > 0.0 {
                *torque = signals.fast(torque);
            } else {
                torque.fill(0.0);
            }
        }
        vec![Regressor::ShaftResponse(change)]
    }
    /// The phase of the vibration depends on when flanks meet, which loads alone determine roughly.
    fn model_error(&self, recording: &DrivetrainResiduals) -> f64 {
        let response = recording.signals.response.as_ref();
        if response.is_some_and(|r| !r.driven.encoders.is_empty()) {
            0.15
        } else {
            0.35
        }
    }
}
