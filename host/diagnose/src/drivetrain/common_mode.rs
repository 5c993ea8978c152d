//! Computes the common mode of the strain residuals, the weighted sum of their parts below 0.6 Hz;
//! and removes a described bending load from them, estimated from all strains by least squares.

use crate::drivetrain::decimation::forward_filled;
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Kind, ResidualSignal};
use crate::sample_statistics::mean;
use crate::smoothing::low_pass_dct;
use loadtwin_machine::{Drift, Machine};

/// Highest frequency of the common load [Hz].
pub(crate) const HIGHEST_HZ: f64 = 0.6;

/// The slow load as each channel has it, and as all have it together.
pub(crate) struct CommonMode {
    /// Of each signal that is a strain, in parts of its full scale.
    pub slow: Vec<Option<Vec<f64>>>,
    /// Sum of these, weighted.
    pub sum: Vec<f64>,
    /// Sum of the weights.
    pub total: f64,
}

impl CommonMode {
    pub fn new(recording: &DrivetrainResiduals) -> Self {
        let slow: Vec<Option<Vec<f64>>> = recording
            .residuals
            .iter()
            .map(|s| {
                (s.kind == Kind::Strain).then(|| low_frequency_part(s, recording.signals.dt_s))
            })
            .collect();
        let mut sum = vec![0.0; recording.signals.len()];
        let mut total = 0.0;
        for (signal, slow) in recording.residuals.iter().zip(&slow) {
            if let Some(slow) = slow {
                total += weight(signal);
                for (sum, value) in sum.iter_mut().zip(slow) {
                    *sum += weight(signal) * value;
                }
            }
        }
        Self { slow, sum, total }
    }
}

/// Removes the described load from the strains, which estimate it together, sample by sample:
///
/// `L = sum_k g_k r_k / v_k / (1 / std^2 + sum_k g_k^2 / v_k)`, `r_k <- r_k - g_k L`.
pub(crate) fn remove_common_mode(machine: &Machine, strains: &mut [ResidualSignal]) {
    let described = machine.drivetrain.as_ref().and_then(|d| d.bending);
    let Some(Drift { std, .. }) = described else {
        return;
    };
    let reading = |signal: &ResidualSignal| {
        let channel = machine.channels.iter().find(|c| c.name == signal.name);
        channel.map_or(0.0, |channel| channel.to_si(channel.bending))
    };
    let readings: Vec<f64> = strains.iter().map(reading).collect();
    for i in 0..strains.first().map_or(0, |s| s.residual.len()) {
        let (mut weighted, mut known) = (0.0, std.powi(-2));
        for (signal, g) in strains.iter().zip(&readings) {
            if signal.residual[i].is_finite() {
                let weight = g / (signal.noise_std * signal.noise_std);
                weighted += weight * signal.residual[i];
                known += weight * g;
            }
        }
        for (signal, g) in strains.iter_mut().zip(&readings) {
            signal.residual[i] -= g * weighted / known;
        }
    }
}

/// What a channel knows of a load that all read.
pub(crate) fn weight(signal: &ResidualSignal) -> f64 {
    (signal.scale / signal.noise_std).powi(2)
}

/// Slow part of a residual about its mean, in parts of full scale; an unknown value repeats the last.
fn low_frequency_part(signal: &ResidualSignal, dt_s: f64) -> Vec<f64> {
    let mut slow = low_pass_dct(&forward_filled(&signal.residual), dt_s, HIGHEST_HZ);
    let mean = mean(slow.iter().copied());
    for value in &mut slow {
        *value = (*value - mean) / signal.scale;
    }
    slow
}
