//! Candidate effect, torsional resonance: a gear with inertia of its own between two inertias,
//! whose vibration the model lacks. Regressor: change of the shaft torques and twists in a
//! simulation with that gear; its shaft and inertia are found by search.

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, NonlinearParameter, Scope};
use crate::drivetrain::candidate_effect::backlash::SHAFT;
use crate::drivetrain::inserted_gear::with_gear;
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Regressor};
use loadtwin_machine::{MOST_INERTIAS, Machine};

/// What the shafts carry with a gear between two inertias, less what they carry
/// without: the description puts its inertia into the neighbours. The gauges'
/// mesh is behind the gear; nothing changes in the balance.
pub struct Resonance;

/// Least part of the response of a gear with the inertia found, for it to become part of the chain.
const LEAST: f64 = 0.5;

const INFO: EffectInfo = EffectInfo {
    name: "torsional-resonance",
    description: "a gear between two inertias vibrates by itself",
    scope: Scope::Machine,
    linear: &[LinearParameter {
        name: "part of what a gear of that inertia does",
        prior_std: 1.0,
    }],
    nonlinear: &[
        SHAFT,
        NonlinearParameter {
            name: "inertia",
            unit: "part of the smaller neighbour's",
            bounds: (0.002, 0.9),
            step: 0.25,
            logarithmic: true,
        },
    ],
    recommended_experiment: "a torque sweep up to the highest torsional mode",
};

impl Effect<DrivetrainResiduals> for Resonance {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, recording: &DrivetrainResiduals) -> Vec<Vec<f64>> {
        /// Inertias of the gear that are tried first, as parts of the smaller neighbour's.
        const PARTS: [f64; 8] = [0.01, 0.03, 0.06, 0.1, 0.16, 0.22, 0.3, 0.4];
        let Some(response) = &recording.signals.response else {
            return Vec::new();
        };
        (0..response.side.len())
            .flat_map(|s| PARTS.map(|part| vec![s as f64, part]))
            .collect()
    }
    fn regressors(&self, recording: &DrivetrainResiduals, shape: &[f64]) -> Vec<Regressor> {
        let change = recording.signals.with_gear(shape[0] as usize, shape[1]);
        change.map(Regressor::ShaftResponse).into_iter().collect()
    }
    /// How the recording's first vibrations go on with the gear.
    fn own_nuisances(&self, recording: &DrivetrainResiduals, shape: &[f64]) -> Vec<Regressor> {
        let vibrations =
            (recording.signals).initial_vibrations_with_gear(shape[0] as usize, shape[1]);
        vibrations
            .into_iter()
            .map(Regressor::ShaftResponse)
            .collect()
    }
    /// What vibrates a little faster is soon out of step.
    fn model_error(&self, _: &DrivetrainResiduals) -> f64 {
        0.4
    }
    fn apply_to_machine(
        &self,
        recording: &DrivetrainResiduals,
        shape: &[f64],
        parameters: &[f64],
        machine: &mut Machine,
    ) -> bool {
        let Some(chain) = &mut machine.drivetrain else {
            return false;
        };
        let Some(response) = &recording.signals.response else {
            return false;
        };
        let name = &response.driven.drivetrain.shafts[shape[0] as usize].name;
        let Some(s) = chain.shafts.iter().position(|s| s.name == *name) else {
            return false;
        };
        // The frequency of the vibration determines the inertia; the small gear that is in the
        // model anyway takes a part of the amplitude.
        let with = with_gear(chain, s, shape[1]);
        // A gear that an earlier diagnosis put there has the name already.
        let is_new = (chain.inertias.iter()).all(|i| i.name != with.inertias[s + 1].name);
        let fits = with.inertias.len() <= MOST_INERTIAS && parameters[0] > LEAST;
        if is_new && fits {
            *chain = with;
        }
        is_new && fits
    }
}
