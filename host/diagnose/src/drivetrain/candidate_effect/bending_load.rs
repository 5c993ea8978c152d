//! Candidate effect, bending load: a slow load other than torque that all strain channels measure.
//! Regressor of each channel: the weighted mean of the other channels' residuals below 0.6 Hz.

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, Scope};
use crate::drivetrain::candidate_effect::{GaugeModel, one_shape};
use crate::drivetrain::common_mode::{CommonMode, HIGHEST_HZ, weight};
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Kind, Regressor, ResidualSignal};
use loadtwin_machine::{Drift, Machine};

/// `scale a L(t)`: a slow load `L` that is the same for all channels, estimated for
/// each channel from the others. The residual of a channel is not used to
/// explain that channel.
pub struct BendingLoad;

const INFO: EffectInfo = EffectInfo {
    name: "bending-load",
    description: "a slow load that is not torque and that all channels read",
    scope: Scope::PerSignal,
    linear: &[LinearParameter {
        name: "part of the other channels' mean",
        prior_std: 1.0,
    }],
    nonlinear: &[],
    recommended_experiment: "a known bending load without torque; gauges in antisymmetric pairs",
};

impl Effect<DrivetrainResiduals> for BendingLoad {
    fn info(&self) -> &EffectInfo {
        &INFO
    }
    fn initial_values(&self, recording: &DrivetrainResiduals) -> Vec<Vec<f64>> {
        let strains = recording
            .residuals
            .iter()
            .filter(|s| s.kind == Kind::Strain);
        if strains.count() >= 3 {
            one_shape()
        } else {
            Vec::new()
        }
    }
    fn applies_to(&self, signal: &ResidualSignal) -> bool {
        signal.kind == Kind::Strain
    }
    fn regressors(&self, recording: &DrivetrainResiduals, _: &[f64]) -> Vec<Regressor> {
        let CommonMode { slow, sum, total } = CommonMode::new(recording);
        let columns = recording
            .residuals
            .iter()
            .zip(&slow)
            .map(|(signal, slow)| {
                slow.as_ref().map_or(Vec::new(), |slow| {
                    let w = weight(signal);
                    sum.iter()
                        .zip(slow)
                        .map(|(sum, own)| signal.scale * (sum - w * own) / (total - w))
                        .collect()
                })
            })
            .collect();
        vec![Regressor::PerSignal(columns)]
    }
    /// Of the mean of all channels, where the parameter is of that of the others:
    /// `g = a (1 - w g) / (1 - w)`, `w` its weight in the mean.
    fn apply_to(&self, _: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        let is_new = gauge.bending == 0.0;
        if is_new {
            let of_others = parameters[0];
            let of_all = of_others / (1.0 + (of_others - 1.0) * gauge.weight);
            gauge.bending = of_all * gauge.full_scale;
        }
        is_new
    }
    /// As a first-order lag that is as large and changes as fast.
    fn apply_to_machine(
        &self,
        recording: &DrivetrainResiduals,
        _: &[f64],
        _: &[f64],
        machine: &mut Machine,
    ) -> bool {
        let Some(chain) = &mut machine.drivetrain else {
            return false;
        };
        let CommonMode { sum, total, .. } = CommonMode::new(recording);
        let rms = |x: &mut dyn Iterator<Item = f64>| {
            let (square, n) = x.fold((0.0, 0.0), |(square, n), x| (square + x * x, n + 1.0));
            f64::sqrt(square / f64::max(n, 1.0))
        };
        let size = rms(&mut sum.iter().copied());
        let change = rms(&mut sum.windows(2).map(|w| w[1] - w[0]));
        let is_new = chain.bending.is_none() && change > 0.0;
        if is_new {
            chain.bending = Some(Drift {
                std: size / total,
                time_s: recording.signals.dt_s * size / change,
            });
        }
        is_new
    }
    fn free_degrees(&self, recording: &DrivetrainResiduals) -> f64 {
        2.0 * HIGHEST_HZ * recording.signals.dt_s * recording.signals.len() as f64
    }
}
