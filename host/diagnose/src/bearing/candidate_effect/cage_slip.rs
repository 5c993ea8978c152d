//! Candidate effect, cage slip: each cage is slower than on the rig under the same loads, by a
//! constant part of its rate. Regressor: minus the predicted rate of the cage, in the slip residual of its row.

use crate::bearing::{BearingResiduals, Kind};
use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, Scope};
use crate::residual_model::SignalSet;

/// A cage goes slower than it did on the rig by a part of its rate: each by its own.
pub struct CageSlip;

const INFO: EffectInfo = EffectInfo {
    name: "cage-slip",
    description: "a cage lags behind rolling balls",
    scope: Scope::PerSignal,
    linear: &[LinearParameter {
        name: "part of the cage's rate",
        prior_std: 0.03,
    }],
    nonlinear: &[],
    recommended_experiment: "the same loads with fresh grease, warm and cold",
};

impl Effect<BearingResiduals> for CageSlip {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, _: &BearingResiduals) -> Vec<Vec<f64>> {
        vec![Vec::new()]
    }
    fn regressors(&self, recording: &BearingResiduals, _: &[f64]) -> Vec<SignalSet> {
        let context = &recording.context;
        vec![recording.each(|kind, i| match (kind, context.place(i)) {
            (Kind::Slip(row), Some(at)) => -context.predicted[at].pace[row],
            _ => 0.0,
        })]
    }
}
