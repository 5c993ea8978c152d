//! Candidate effect, loose or dead gauge: from a moment on a gauge loses part or all of its
//! response, and its offset jumps. Regressors: minus the predicted response of the gauge, and a
//! step, both after the moment; gauge and moment are found by search.

use loadtwin_common::bearing::GAUGES;

use crate::bearing::{BearingResiduals, Kind};
use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, NonlinearParameter, Scope};
use crate::residual_model::SignalSet;

/// Moments of the loss that are tried first, evenly over the recording.
const MOMENTS: usize = 16;

/// From a moment on the response of a gauge is less by a part, all of it where it is dead, and its zero jumps.
pub struct LooseGauge;

const INFO: EffectInfo = EffectInfo {
    name: "loose-gauge",
    description: "a gauge answers less from a moment on; a part of 1 is a dead one",
    scope: Scope::Machine,
    linear: &[
        LinearParameter {
            name: "part of the answer that is lost",
            prior_std: 0.5,
        },
        LinearParameter {
            name: "jump of the zero [µm/m]",
            prior_std: 30.0,
        },
    ],
    nonlinear: &[
        NonlinearParameter {
            name: "gauge",
            unit: "from 0",
            bounds: (0.0, f64::INFINITY),
            step: 0.0,
            logarithmic: false,
        },
        NonlinearParameter {
            name: "moment",
            unit: "s",
            bounds: (0.0, f64::INFINITY),
            step: 0.5,
            logarithmic: false,
        },
    ],
    recommended_experiment: "shunt calibration of the gauge, and the same loads again",
};

impl Effect<BearingResiduals> for LooseGauge {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, recording: &BearingResiduals) -> Vec<Vec<f64>> {
        let last = recording.t.last().copied().unwrap_or(0.0);
        let moment = move |k: usize| last * k as f64 / MOMENTS as f64;
        (0..GAUGES)
            .flat_map(|g| (0..MOMENTS).map(move |k| vec![g as f64, moment(k)]))
            .collect()
    }
    fn regressors(&self, recording: &BearingResiduals, shape: &[f64]) -> Vec<SignalSet> {
        let context = &recording.context;
        let own = shape[0] as usize;
        let since = |i: usize| recording.t[i] >= shape[1];
        let answer = recording.each(|kind, i| {
            let answer = (context.place(i).filter(|_| since(i))).and_then(|at| {
                let strain = &context.predicted[at].strain[own];
                match kind {
                    Kind::Bulk(g) if g == own => {
                        Some(strain[0] - context.calibration.gauge[g].offset)
                    }
                    Kind::Local(g) if g == own => context.along(at, g, strain),
                    _ => None,
                }
            });
            -answer.unwrap_or(0.0)
        });
        let jump =
            recording.each(|kind, i| f64::from(u8::from(kind == Kind::Bulk(own) && since(i))));
        vec![answer, jump]
    }
    fn location(&self, recording: &BearingResiduals, shape: &[f64]) -> Option<String> {
        Some(
            recording.context.bearing.gauges[shape[0] as usize]
                .name
                .clone(),
        )
    }
}
