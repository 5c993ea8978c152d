//! Candidate effect, mains interference: a sinusoid near 50 or 60 Hz in a strain channel.

use std::f64::consts::TAU;

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, NonlinearParameter, Scope};
use crate::drivetrain::candidate_effect::each;
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Kind, Regressor, ResidualSignal};

/// `scale (a cos(2 pi f t) + b sin(2 pi f t))`, `f` near 50 or 60 Hz;
/// aliased as the samples alias it.
pub struct MainsInterference;

const INFO: EffectInfo = EffectInfo {
    name: "mains-pick-up",
    description: "an oscillation of the mains",
    scope: Scope::PerSignal,
    linear: &[
        LinearParameter {
            name: "cosine, part of full scale",
            prior_std: 0.05,
        },
        LinearParameter {
            name: "sine, part of full scale",
            prior_std: 0.05,
        },
    ],
    nonlinear: &[NonlinearParameter {
        name: "frequency",
        unit: "Hz",
        bounds: (10.0, 200.0),
        step: 0.003,
        logarithmic: false,
    }],
    recommended_experiment: "standstill without load, at twice the sample rate",
};

impl Effect<DrivetrainResiduals> for MainsInterference {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, recording: &DrivetrainResiduals) -> Vec<Vec<f64>> {
        // Grids keep within 0.1 Hz; a step is what the duration resolves.
        let duration = recording.signals.dt_s * recording.signals.len() as f64;
        let step = (0.4 / duration).max(0.002);
        let count = ((0.1 / step).ceil() as i32).min(40);
        let around = |f: f64| (-count..=count).map(move |i| f + f64::from(i) * step);
        let values: Vec<f64> = [50.0, 60.0].into_iter().flat_map(around).collect();
        each(&values)
    }
    fn applies_to(&self, signal: &ResidualSignal) -> bool {
        signal.kind == Kind::Strain
    }
    /// The phase is that of the recording.
    fn is_machine_property(&self) -> bool {
        false
    }
    fn regressors(&self, recording: &DrivetrainResiduals, shape: &[f64]) -> Vec<Regressor> {
        let t = &recording.signals.t;
        let phase = |t: &f64| TAU * (shape[0] * t).fract();
        vec![
            Regressor::Offset(t.iter().map(|t| phase(t).cos()).collect()),
            Regressor::Offset(t.iter().map(|t| phase(t).sin()).collect()),
        ]
    }
}
