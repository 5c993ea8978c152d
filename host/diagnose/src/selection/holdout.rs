//! Validates the effects found on hold-out recordings: removes a further effect that does not
//! reduce the residuals there.

use crate::candidate_effect::fitted::FittedEffect;
use crate::regression::joint_fit::{fit_jointly, residuals_after, subtract_effects};
use crate::residual_model::ResidualModel;
use crate::selection::stepwise::Selection;

/// Standard deviations that a zero may be off in a recording that took no part in the fit.
const MAX_OFFSET_SIGMA: f64 = 3.0;

/// Fraction of the mean square of a residual that an effect must predict in a hold-out recording for that
/// recording to test it.
const MIN_VISIBLE: f64 = 0.05;

impl<S: ResidualModel> Selection<S> {
    /// Keeps of the further effects those that explain recordings which took no part in the
    /// search; one that is not observable in these is kept as the search found it.
    pub fn validate_on(&mut self, recordings: &[S], holdout: &[S]) {
        let mut kept: Vec<FittedEffect<S>> = Vec::new();
        let mut left = Vec::new();
        for found in &self.found {
            let mut with = kept.clone();
            with.push(found.clone());
            let lasting = MachineEffects::fitted(recordings, &with);
            let log_mean_squares = lasting.log_mean_squares(holdout);
            let acting = |k: &usize| !found.parameters[*k].is_empty();
            let sum = |log_mean_squares: &[f64]| {
                (0..log_mean_squares.len())
                    .filter(acting)
                    .map(|k| log_mean_squares[k])
                    .sum::<f64>()
            };
            let accepted = kept.is_empty()
                || !found.effect.is_machine_property()
                || sum(&log_mean_squares) < sum(&left);
            if accepted || !lasting.tests_last(holdout) {
                (kept, left) = (with, log_mean_squares);
            }
        }
        if kept.len() < self.found.len() {
            self.keep(recordings, kept);
        }
    }
}

/// Effects that are those of the machine, fitted together with those of the recording alone.
struct MachineEffects<S: ResidualModel>(Vec<FittedEffect<S>>);

impl<S: ResidualModel> MachineEffects<S> {
    fn fitted(recordings: &[S], found: &[FittedEffect<S>]) -> Self {
        let mut found = found.to_vec();
        fit_jointly(recordings, &mut found, None);
        found.retain(|f| f.effect.is_machine_property());
        Self(found)
    }

    /// For each signal the sum of the logarithms of the residual mean squares of `holdout`.
    fn log_mean_squares(&self, holdout: &[S]) -> Vec<f64> {
        let mut log_mean_squares = vec![0.0; holdout[0].residuals().len()];
        for recording in holdout {
            let (zeros, left) = left_by(&self.0, recording);
            for (k, (size, left)) in log_mean_squares.iter_mut().zip(&left).enumerate() {
                // Zeros differ from recording to recording, though not without bound.
                let beyond = (zeros[k].abs() - MAX_OFFSET_SIGMA * recording.zero_std(k)).max(0.0);
                *size += (square(left) + beyond * beyond).max(1e-300).ln();
            }
        }
        log_mean_squares
    }

    /// Whether the last one predicts something of `holdout`.
    fn tests_last(&self, holdout: &[S]) -> bool {
        let Some((_, others)) = self.0.split_last() else {
            return false;
        };
        holdout.iter().any(|recording| {
            let one = std::slice::from_ref(recording);
            let none = vec![Vec::new(); recording.residuals().len()];
            let (with, subtract_effects) = (
                residuals_after(one, &self.0, &none),
                residuals_after(one, others, &none),
            );
            let (_, left) = left_by(&self.0, recording);
            let signals = with[0].iter().zip(&subtract_effects[0]).zip(&left);
            signals.into_iter().any(|((with, subtract_effects), left)| {
                let predicted: Vec<f64> = subtract_effects
                    .iter()
                    .zip(with)
                    .map(|(a, b)| a - b)
                    .collect();
                square(&predicted) > MIN_VISIBLE * square(left)
            })
        })
    }
}

/// Residual of each signal of a hold-out recording after the effects `found`, and its zero; the
/// nuisances of each recording (zeros, counts, initial vibration) are fitted anew.
fn left_by<S: ResidualModel>(
    found: &[FittedEffect<S>],
    recording: &S,
) -> (Vec<f64>, Vec<Vec<f64>>) {
    let none = vec![Vec::new(); recording.residuals().len()];
    let one = subtract_effects(std::slice::from_ref(recording), found, &none);
    // Subtracted already: only their own nuisances remain.
    let mut subtracted = found.to_vec();
    for f in &mut subtracted {
        f.parameters.clone_from(&none);
    }
    let nuisance = fit_jointly(&one, &mut subtracted, None);
    let zeros = nuisance.iter().map(|n| n.first().copied().unwrap_or(0.0));
    (
        zeros.collect(),
        residuals_after(&one, &subtracted, &nuisance).remove(0),
    )
}

/// Mean square about the mean of the known values.
fn square(values: &[f64]) -> f64 {
    let known = values.iter().filter(|v| v.is_finite());
    let n = known.clone().count().max(1) as f64;
    let mean = known.clone().sum::<f64>() / n;
    known.map(|v| (v - mean).powi(2)).sum::<f64>() / n
}
