//! Candidate effect, preload other than calibrated, by setting or wear. Regressor: the change of
//! strains and cage rates that the bearing model predicts for a changed preload, over that change.
//! The improved description gets the preload found.

use crate::bearing::{BearingResiduals, BearingTarget, Kind};
use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, Scope};
use crate::residual_model::SignalSet;

/// Least change of the preload over which the response is differentiated, relative.
const SMALL: f64 = 0.1;

/// Largest change of the preload at which the response is evaluated, relative.
const MOST: f64 = 0.6;

/// What gauges and cages do with an approach that is larger by the part `q`, over `q`.
pub struct Preload;

const INFO: EffectInfo = EffectInfo {
    name: "preload",
    description: "the rows are pressed together more or less than when calibrated",
    scope: Scope::Machine,
    linear: &[LinearParameter {
        name: "part of the preload's approach",
        prior_std: 0.2,
    }],
    nonlinear: &[],
    recommended_experiment: "the same with moments of both signs, and a light load",
};

impl Effect<BearingResiduals> for Preload {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, _: &BearingResiduals) -> Vec<Vec<f64>> {
        vec![Vec::new()]
    }
    fn is_linear(&self) -> bool {
        false
    }
    fn regressors(&self, recording: &BearingResiduals, _: &[f64]) -> Vec<SignalSet> {
        vec![changed(recording, SMALL)]
    }
    fn regressors_at(
        &self,
        recording: &BearingResiduals,
        _: &[f64],
        parameters: &[Vec<f64>],
    ) -> Vec<SignalSet> {
        let by = parameters.iter().flatten().next().copied().unwrap_or(0.0);
        let by = if by.abs() < SMALL { SMALL } else { by };
        vec![changed(recording, by.clamp(-MOST, MOST))]
    }
    fn apply_to(&self, _: &[f64], parameters: &[f64], place: &mut BearingTarget) -> bool {
        if let Some(bearing) = &mut place.bearing {
            bearing.preload_um *= 1.0 + parameters[0];
        }
        place.bearing.is_some()
    }
}

/// What changes with the preload's approach by the part `by`, over that.
fn changed(recording: &BearingResiduals, by: f64) -> SignalSet {
    let context = &recording.context;
    let mut calibration = context.calibration.clone();
    let preload = &mut calibration.physical.preload;
    *preload = (1.0 + *preload) * (1.0 + by) - 1.0;
    let Some(other) = context.predicted_with(&calibration) else {
        return recording.each(|_, _| 0.0);
    };
    recording.each(|kind, i| {
        let difference = context.place(i).and_then(|at| {
            let (is, was) = (&other[at], &context.predicted[at]);
            let strain = |g: usize| std::array::from_fn(|k| is.strain[g][k] - was.strain[g][k]);
            match kind {
                Kind::Bulk(g) => Some(is.strain[g][0] - was.strain[g][0]),
                Kind::Local(g) => context.along(at, g, &strain(g)),
                Kind::Slip(row) => Some(is.pace[row] - was.pace[row]),
            }
        });
        difference.unwrap_or(0.0) / by
    })
}
