//! Computes the mean absolute load error of a drivetrain (% of nominal torque) from the strain
//! residuals by weighted least squares over the gauges: without and with the effects found, as
//! described and recalibrated. It is only known where the torque comes from references.

use crate::candidate_effect::fitted::FittedEffect;
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Kind, TorqueSource};
use crate::error_interval::means;
use crate::error_interval::{BeforeAfter, Interval, LoadErrors};
use crate::regression::joint_fit::residuals_after;

/// Length of the blocks over which errors are summed [s].
const BLOCK_S: f64 = 2.0;

/// Errors of `recordings` without and with the effects found.
///
/// Sample by sample the torque is that which explains the gauges best:
/// `sum(m r / s^2) / sum(m^2 / s^2)`.
pub fn load_errors(
    recordings: &[DrivetrainResiduals],
    found: &[FittedEffect<DrivetrainResiduals>],
) -> LoadErrors {
    let nominal: Vec<Vec<Vec<f64>>> = recordings
        .iter()
        .map(|s| s.residuals.iter().map(|k| k.residual.clone()).collect())
        .collect();
    // Nuisances are left as they are.
    let zeros = vec![Vec::new(); recordings[0].residuals.len()];
    let with_effects = residuals_after(recordings, found, &zeros);
    let again = |residuals: &[Vec<Vec<f64>>]| recalibrated(recordings, residuals);
    let figure = |residuals: &[Vec<Vec<f64>>]| interval(recordings, residuals);
    LoadErrors {
        nominal: BeforeAfter {
            before: figure(&nominal),
            after: figure(&with_effects),
        },
        recalibrated: BeforeAfter {
            before: figure(&again(&nominal)),
            after: figure(&again(&with_effects)),
        },
    }
}

/// Residuals less the best zero and gain of each strain.
fn recalibrated(
    recordings: &[DrivetrainResiduals],
    residuals: &[Vec<Vec<f64>>],
) -> Vec<Vec<Vec<f64>>> {
    let mut out = residuals.to_vec();
    for k in 0..recordings[0].residuals.len() {
        if recordings[0].residuals[k].kind != Kind::Strain {
            continue;
        }
        let mut gram = faer::Mat::<f64>::zeros(2, 2);
        let mut right = faer::Mat::<f64>::zeros(2, 1);
        for (recording, residual) in recordings.iter().zip(residuals) {
            let reading = &recording.residuals[k].reading;
            for (r, x) in residual[k]
                .iter()
                .zip(reading)
                .filter(|(r, _)| r.is_finite())
            {
                let row = [1.0, *x];
                for a in 0..2 {
                    right[(a, 0)] += row[a] * r;
                    for b in 0..2 {
                        gram[(a, b)] += row[a] * row[b];
                    }
                }
            }
        }
        let fit = crate::regression::normal_equations::solve_ridge(gram, &right, &[0.0, 0.0]);
        for (recording, out) in recordings.iter().zip(&mut out) {
            for (r, x) in out[k].iter_mut().zip(&recording.residuals[k].reading) {
                *r -= fit[(0, 0)] + fit[(1, 0)] * x;
            }
        }
    }
    out
}

fn interval(recordings: &[DrivetrainResiduals], residuals: &[Vec<Vec<f64>>]) -> Interval {
    // Sum and count of each block.
    let mut blocks: Vec<(f64, f64)> = Vec::new();
    for (recording, residual) in recordings.iter().zip(residuals) {
        let length = ((BLOCK_S / recording.signals.dt_s) as usize).max(1);
        let errors: Vec<f64> = (0..recording.signals.len())
            .map(|i| error(recording, residual, i))
            .collect();
        for block in errors.chunks(length) {
            let known = block.iter().filter(|e| e.is_finite());
            blocks.push((known.clone().map(|e| e.abs()).sum(), known.count() as f64));
        }
    }
    // What the gauges say is no reference for itself.
    if recordings
        .iter()
        .any(|s| s.torque_source != TorqueSource::References)
    {
        blocks.clear();
    }
    means(&blocks)
}

/// Error of sample `i`, part of nominal torque.
fn error(recording: &DrivetrainResiduals, residual: &[Vec<f64>], i: usize) -> f64 {
    let (mut sum, mut weight) = (0.0, 0.0);
    for (signal, residual) in recording.residuals.iter().zip(residual) {
        if signal.kind == Kind::Strain && signal.shaft.is_some() && residual[i].is_finite() {
            let m = signal.map[i] / signal.noise_std;
            sum += m * residual[i] / signal.noise_std;
            weight += m * m;
        }
    }
    sum / weight / recording.signals.nominal_torque
}
