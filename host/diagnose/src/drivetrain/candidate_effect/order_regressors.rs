//! Computes the cosine and sine of an order of the carrier angle for each decimated sample,
//! attenuated as the mean over its raw samples attenuates them: regressors that several effects
//! share.

use crate::candidate_effect::LinearParameter;
use crate::drivetrain::residual_signals::DrivetrainResiduals;

/// Highest order of the carrier that is tried.
pub(crate) const HIGHEST: usize = 12;

pub(crate) const AMPLITUDES: &[LinearParameter] = &[
    LinearParameter {
        name: "cosine, part of full scale at nominal load",
        prior_std: 0.1,
    },
    LinearParameter {
        name: "sine, part of full scale at nominal load",
        prior_std: 0.1,
    },
];

/// Cosine and sine of an order of the carrier angle, as the mean of the raw samples in one has them:
/// of `n` samples `2 x` apart `sin(n x) / (n sin(x))` remains of a wave.
pub fn fourier_pair(recording: &DrivetrainResiduals, order: f64) -> [Vec<f64>; 2] {
    let signals = &recording.signals;
    let n = signals.means_of as f64;
    let left = |speed: &f64| {
        let x = 0.5 * order * speed * signals.dt_s / n;
        let whole = n * x.sin();
        if whole.abs() < 1e-9 {
            1.0
        } else {
            (n * x).sin() / whole
        }
    };
    let along = |wave: fn(f64) -> f64| {
        let samples = signals.angle.iter().zip(&signals.speed);
        samples.map(|(a, w)| left(w) * wave(order * a)).collect()
    };
    [along(f64::cos), along(f64::sin)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drivetrain::decimated_signals::Signals;
    use crate::drivetrain::residual_signals::TorqueSource;

    /// Order 3 at 50 rad/s, 4 samples of 2 ms in a mean: sin(0.6) / (4 sin(0.15)) = 0.945 of it remains.
    #[test]
    fn a_wave_is_the_mean_of_the_samples_in_it() {
        const EVERY: usize = 4;
        let (raw_s, speed) = (0.002, 50.0);
        let raw = |i: usize| speed * raw_s * i as f64;
        let of_wave = |i: usize| (3.0 * raw(i)).cos();
        let mean = |of: &dyn Fn(usize) -> f64, k: usize| {
            (EVERY * k..EVERY * (k + 1)).map(of).sum::<f64>() / EVERY as f64
        };
        let recording = DrivetrainResiduals {
            signals: Signals {
                dt_s: EVERY as f64 * raw_s,
                means_of: EVERY,
                angle: (0..100).map(|k| mean(&raw, k)).collect(),
                speed: vec![speed; 100],
                ..Signals::default()
            },
            residuals: Vec::new(),
            twist: Vec::new(),
            operating_profile: None,
            torque_source: TorqueSource::References,
            missing_references: Vec::new(),
            reference_noise: Vec::new(),
        };
        let [cosine, _] = fourier_pair(&recording, 3.0);
        for (k, value) in cosine.iter().enumerate() {
            assert!((value - mean(&of_wave, k)).abs() < 1e-12, "{k}");
        }
        let most = cosine.iter().fold(0.0_f64, |most, c| most.max(c.abs()));
        assert!((0.93..0.945).contains(&most), "{most}");
    }
}
