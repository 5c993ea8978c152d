//! Candidate effect, delay of a strain channel. Regressor: its predicted reading shifted in time,
//! minus that reading itself; the shift is found by search.

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, NonlinearParameter, Scope};
use crate::drivetrain::candidate_effect::{GaugeModel, each};
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Kind, Regressor, ResidualSignal};
use loadtwin_machine::LATEST_S;

/// `reading(t - d) - reading(t)`, times 1 where the whole channel is late.
pub struct Delay;

const INFO: EffectInfo = EffectInfo {
    name: "channel-delay",
    description: "a channel comes late",
    scope: Scope::PerSignal,
    linear: &[LinearParameter {
        name: "part of the reading that is late",
        prior_std: 1.0,
    }],
    nonlinear: &[NonlinearParameter {
        name: "delay",
        unit: "s",
        bounds: (-LATEST_S, LATEST_S),
        step: 0.004,
        logarithmic: false,
    }],
    recommended_experiment: "steps of torque",
};

impl Effect<DrivetrainResiduals> for Delay {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, _: &DrivetrainResiduals) -> Vec<Vec<f64>> {
        each(&[-0.03, -0.01, 0.002, 0.006, 0.012, 0.02, 0.03, 0.05])
    }
    fn applies_to(&self, signal: &ResidualSignal) -> bool {
        signal.kind == Kind::Strain
    }
    fn regressors(&self, recording: &DrivetrainResiduals, shape: &[f64]) -> Vec<Regressor> {
        let late = shape[0] / recording.signals.dt_s;
        let (whole, part) = (late.floor() as isize, late - late.floor());
        let weights = cubic(part);
        let column = |s: &ResidualSignal| {
            let last = s.reading.len() as isize - 1;
            let at = |i: isize| s.reading[i.clamp(0, last) as usize];
            let delayed = |i: isize| -> f64 {
                let newest = i - whole + 1;
                (weights.iter().zip(0..))
                    .map(|(w, j)| w * at(newest - j))
                    .sum()
            };
            (0..=last).map(|i| delayed(i) - at(i)).collect()
        };
        vec![Regressor::PerSignal(
            recording.residuals.iter().map(column).collect(),
        )]
    }
    /// Where some channel is late by more than what times are known to.
    fn is_relevant(
        &self,
        recording: &DrivetrainResiduals,
        shape: &[f64],
        parameters: &[Vec<f64>],
    ) -> bool {
        let late_s = |part: &f64| (part * shape[0]).abs();
        (parameters.iter().flatten())
            .any(|part| late_s(part) > recording.signals.time_tolerance_s())
    }
    fn apply_to(&self, shape: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        // Where the reading moves slowly only the product is observable.
        let late_s = gauge.late_s + parameters[0] * shape[0];
        // The line waits for no channel: one that comes early makes the others late.
        let has_place = (0.0..=LATEST_S).contains(&late_s);
        if has_place {
            gauge.late_s = late_s;
        }
        has_place
    }
}

/// Weights of four samples, the newest first, for the value `part` of a sample older than the
/// second: Lagrange's cubic. A straight line would smooth, and a map over the angle bends within
/// a sample.
fn cubic(part: f64) -> [f64; 4] {
    let (newer, here, older, oldest) = (part + 1.0, part, part - 1.0, part - 2.0);
    [
        -here * older * oldest / 6.0,
        newer * older * oldest / 2.0,
        -newer * here * oldest / 2.0,
        newer * here * older / 6.0,
    ]
}
