//! Candidate effect, stiffness of a bearing other than described: a factor along x and one along y,
//! found by search. Regressor: residuals as described less those with the changed stiffness, each
//! after its own fit of the unbalance.

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, NonlinearParameter, Scope};
use crate::residual_model::SignalSet;
use crate::rotor::candidate_effect::{RUN_UP, location_parameter};
use crate::rotor::{RotorResiduals, RotorTarget};
use loadtwin_machine::Rotor;

/// Factors on a stiffness from which the search starts.
const FACTORS: [f64; 6] = [0.4, 0.6, 0.8, 1.25, 1.7, 2.5];

/// What a bearing of another stiffness along x and y explains beyond the described one, each with
/// the unbalance and the uncertain parameters that fit it best: by 1 where the stiffness is right.
/// Those that fit the described rotor would hold a part of what the stiffness does.
pub struct BearingStiffness;

const fn factor(name: &'static str) -> NonlinearParameter {
    NonlinearParameter {
        name,
        unit: "of the stiffness described",
        bounds: (0.1, 10.0),
        step: 0.15,
        logarithmic: true,
    }
}

const ALL: &[NonlinearParameter] = &[
    location_parameter("bearing", "from 0"),
    factor("along x"),
    factor("along y"),
];

const INFO: EffectInfo = EffectInfo {
    name: "bearing-stiffness",
    description: "a bearing is softer or stiffer than described",
    scope: Scope::Machine,
    linear: &[LinearParameter {
        name: "part of what such a bearing explains",
        prior_std: 1.0,
    }],
    nonlinear: ALL,
    recommended_experiment: RUN_UP,
};

impl Effect<RotorResiduals> for BearingStiffness {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, recording: &RotorResiduals) -> Vec<Vec<f64>> {
        (0..recording.rotor().bearings.len())
            .flat_map(|bearing| FACTORS.map(|factor| vec![bearing as f64, factor, factor]))
            .collect()
    }
    fn regressors(&self, recording: &RotorResiduals, shape: &[f64]) -> Vec<SignalSet> {
        vec![recording.explained_beyond(&changed(recording.described(), shape))]
    }
    fn location(&self, recording: &RotorResiduals, shape: &[f64]) -> Option<String> {
        let bearing = &recording.rotor().bearings[shape[0] as usize];
        Some(format!("node {}", bearing.node))
    }
    fn apply_to(&self, shape: &[f64], _: &[f64], target: &mut RotorTarget) -> bool {
        let rotor = target.machine.rotor.as_mut();
        let Some(rotor) = rotor.filter(|r| r.ross_model.is_none()) else {
            return false;
        };
        *rotor = changed(rotor, shape);
        rotor.bearings[shape[0] as usize].table.is_empty()
    }
}

/// `rotor` with the stiffness of a bearing along x and y multiplied, what couples them by the
/// mean of both.
fn changed(rotor: &Rotor, shape: &[f64]) -> Rotor {
    let mut rotor = rotor.clone();
    let factors = [shape[1], shape[2]];
    let own = &mut rotor.bearings[shape[0] as usize];
    let table = own.table.iter_mut().map(|at| &mut at.stiffness_n_per_m);
    for stiffness in own.stiffness_n_per_m.iter_mut().chain(table) {
        for (row, a) in stiffness.iter_mut().zip(factors) {
            for (k, b) in row.iter_mut().zip(factors) {
                *k *= (a * b).sqrt();
            }
        }
    }
    rotor
}
