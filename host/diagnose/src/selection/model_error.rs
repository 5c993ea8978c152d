//! Estimates the model errors of the effects found, the residuals that imperfect models leave, and
//! discounts them from the evidence of a further candidate. Also computes the part of an excess
//! that a candidate explains.

use crate::candidate_effect::fitted::{FittedEffect, is_free_signal};
use crate::candidate_effect::{Effect, Scope};
use crate::regression::cross_validation::RegressionData;
use crate::regression::design_matrix::columns;
use crate::residual_model::ResidualModel;
use crate::selection::candidates::RankedCandidate;
use crate::selection::score::CandidateScore;
use crate::smoothing::smooth;

/// Relative tolerance of the simulated mean square of a fault-free machine,
/// where vibrations are most of it.
pub(crate) const MEAN_SQUARE_TOLERANCE: f64 = 0.03;

/// Largest ratio of the relative model errors of one effect in two gauges.
const MAX_SPREAD_RATIO: f64 = 3.0;

/// Largest fraction of the excess that a candidate may leave and be accepted
/// whatever the model errors.
const CLEARED_RATIO: f64 = 0.1;

/// Largest relative deviation of the parameters of two effects in the gauges, in the mean square, where
/// they are proportional: as far as the parameters of one effect depart where its time law is another.
const PROPORTIONAL: f64 = 0.1;

/// Model errors of the effects found.
pub(crate) struct ModelErrors<'a, S: ResidualModel> {
    data: &'a RegressionData,
    recordings: &'a [S],
    found: &'a [FittedEffect<S>],
    /// Octaves in which the model error of an effect may lie: `[effect][signal]`.
    spectra: Vec<Vec<Vec<f64>>>,
}

impl<'a, S: ResidualModel> ModelErrors<'a, S> {
    /// Of `found` in `recordings`.
    pub fn new(
        data: &'a RegressionData,
        recordings: &'a [S],
        found: &'a [FittedEffect<S>],
    ) -> Self {
        let spectra = (found.iter())
            .map(|f| spectra(recordings, f.effect, &f.shape, &f.parameters))
            .map(|of_streams| of_streams.iter().map(|s| harmonic_spread(s)).collect())
            .collect();
        Self {
            data,
            recordings,
            found,
            spectra,
        }
    }

    /// `candidate` without the evidence that model errors account for, where it explains more than the model
    /// errors of the effects found, a free signal twice
    /// as much; in squares relative to the final residual.
    ///
    /// A signal in which model errors may account for everything is ignored: model errors of effects
    /// with per-signal parameters, and for a candidate with such parameters those of shared effects as
    /// well. A signal that the candidate clears always counts.
    pub fn discount(&self, candidate: &RankedCandidate<S>) -> Option<RankedCandidate<S>> {
        let trial = &candidate.score;
        let times = if is_free_signal(self.recordings, candidate.effect) {
            2.0
        } else {
            1.0
        };
        let own = spectra(
            self.recordings,
            candidate.effect,
            &trial.shape,
            &candidate.parameters,
        );
        let alone = candidate.effect.scope() == Scope::PerSignal;
        let most = trial.per_signal.iter().copied().fold(0.0, f64::max);
        let explained: Vec<Vec<f64>> = (trial.per_signal.iter().enumerate())
            .map(|(k, gain)| self.explained(k, gain.max(0.0)))
            .collect();
        let model_errors = self.model_errors(trial, times > 1.0, &explained);
        let follows = times > 1.0
            && (self.found.iter())
                .any(|f| are_proportional(&candidate.parameters, &f.parameters, &trial.per_signal));
        let (mut score, mut brought, mut before) = (trial.log_evidence, 0.0, 0.0);
        for (k, gain) in trial.per_signal.iter().enumerate() {
            if *gain <= 0.02 * most {
                continue;
            }
            let remaining_excess = |coupling| {
                times * self.model_error_squares(coupling, k, &model_errors, &explained[k], &own[k])
            };
            let explained = self.data.explained_sum_of_squares(k, *gain);
            let part = explained / self.data.effective_samples(k);
            let (by_own, by_shared) = (
                remaining_excess(Scope::PerSignal),
                remaining_excess(Scope::Machine),
            );
            let by_itself = by_own + if alone { by_shared } else { 0.0 };
            if !follows && clears_excess(trial.excess[k], part) {
                brought += explained;
            } else if explained < by_itself {
                score -= gain;
            } else {
                brought += explained;
                before += by_own + by_shared;
            }
        }
        let mut counted = candidate.clone();
        counted.score.log_evidence = score;
        (brought > before).then_some(counted)
    }

    /// Squares of signal `k` that each effect found explains, relative to the mean square that remains
    /// beside further evidence `later`.
    fn explained(&self, k: usize, mut later: f64) -> Vec<f64> {
        let mut explained = vec![0.0; self.found.len()];
        for (f, explained) in self.found.iter().zip(&mut explained).rev() {
            let gain = f.per_signal[k].max(0.0);
            *explained = self.data.explained_sum_of_squares(k, later + gain)
                - self.data.explained_sum_of_squares(k, later);
            later += gain;
        }
        explained
    }

    /// Squared relative model error of each effect found, where
    /// they explain `explained[signal][effect]` beside `candidate`.
    ///
    /// An effect with per-signal parameters has one model in all gauges, so that its relative
    /// residual is similar in all: the gauge with the least relative residual bounds the others.
    /// A free signal is exempt: it follows the gauge that shows it best. So is a
    /// free candidate, which may absorb the model error of one gauge only.
    fn model_errors(
        &self,
        candidate: &CandidateScore,
        is_free: bool,
        explained: &[Vec<f64>],
    ) -> Vec<f64> {
        let at_most = |i: usize| {
            let parts = explained.iter().zip(&candidate.per_signal).enumerate();
            let parts = parts.map(|(k, (explained, gain))| {
                let all = self.data.effective_samples(k)
                    + self.data.explained_sum_of_squares(k, gain.max(0.0));
                all / explained[i]
            });
            MAX_SPREAD_RATIO * parts.fold(f64::INFINITY, f64::min)
        };
        let squared = |(i, f): (usize, &FittedEffect<S>)| {
            let squared = f.effect.model_error(&self.recordings[0]).powi(2);
            let same =
                f.effect.scope() == Scope::PerSignal && !is_free_signal(self.recordings, f.effect);
            if same && !is_free {
                squared.min(at_most(i))
            } else {
                squared
            }
        };
        self.found.iter().enumerate().map(squared).collect()
    }

    /// Squares of signal `k` that those found of that coupling may have left, by their `model_errors`, of
    /// what they have `explained`, where a candidate has the spectrum `own`.
    fn model_error_squares(
        &self,
        coupling: Scope,
        k: usize,
        model_errors: &[f64],
        explained: &[f64],
        own: &[f64],
    ) -> f64 {
        let of_each = self.found.iter().enumerate();
        of_each
            .filter(|(_, f)| f.effect.scope() == coupling)
            .map(|(i, _)| {
                model_errors[i] * spectral_overlap(own, &self.spectra[i][k]) * explained[i]
            })
            .sum()
    }
}

/// Part of the excess over a fault-free machine that `trial` explains, its mean over signals by their
/// evidence; all of it where there is none.
pub(crate) fn excess_explained(data: &RegressionData, trial: &CandidateScore) -> f64 {
    let (mut excess_explained, mut all) = (0.0, 0.0);
    for (k, gain) in trial.per_signal.iter().map(|g| g.max(0.0)).enumerate() {
        let excess = trial.excess[k];
        let part = data.explained_sum_of_squares(k, gain) / data.effective_samples(k);
        let remains = if excess > MEAN_SQUARE_TOLERANCE {
            remaining_excess(excess, part).max(0.0) / excess
        } else {
            0.0
        };
        all += gain;
        excess_explained += gain * (1.0 - remains);
    }
    excess_explained / all.max(f64::MIN_POSITIVE)
}

/// Remaining excess over the mean square of a fault-free machine, once `explained` times
/// the final mean square is explained.
pub(crate) fn remaining_excess(excess: f64, explained: f64) -> f64 {
    (1.0 + excess) / (1.0 + explained) - 1.0
}

/// Whether that is next to nothing.
fn clears_excess(excess: f64, explained: f64) -> bool {
    explained > 0.2
        && remaining_excess(excess, explained) < CLEARED_RATIO * excess + MEAN_SQUARE_TOLERANCE
}

/// Whether a candidate has in each gauge the same multiple of the first parameter of an effect found,
/// weighted by the evidence of the candidate in that gauge.
fn are_proportional(candidate: &[Vec<f64>], found: &[Vec<f64>], evidence: &[f64]) -> bool {
    let most = evidence.iter().copied().fold(0.0, f64::max);
    let (mut gauges, mut weights, mut sum, mut squares) = (0, 0.0, 0.0, 0.0);
    for ((own, other), weight) in candidate.iter().zip(found).zip(evidence) {
        if *weight <= 0.02 * most {
            continue;
        }
        let Some(other) = other.first().filter(|other| **other != 0.0) else {
            return false;
        };
        let ratio = own.first().map_or(0.0, |own| own / other);
        gauges += 1;
        weights += weight;
        sum += weight * ratio;
        squares += weight * ratio * ratio;
    }
    let relative_variance = squares * weights / (sum * sum) - 1.0;
    gauges > 1 && relative_variance < PROPORTIONAL * PROPORTIONAL
}

/// Octaves of the prediction of an effect for each signal; empty where it does not act.
fn spectra<S: ResidualModel>(
    recordings: &[S],
    effect: &dyn Effect<S>,
    shape: &[f64],
    parameters: &[Vec<f64>],
) -> Vec<Vec<f64>> {
    let columns = columns(recordings, effect, shape, parameters);
    (parameters.iter().enumerate())
        .map(|(k, parameters)| {
            let mut predicted = Vec::new();
            for (column, value) in columns.iter().zip(parameters) {
                predicted.resize(column[k].len(), 0.0);
                for (p, c) in predicted.iter_mut().zip(&column[k]) {
                    *p += value * c;
                }
            }
            spectrum(predicted)
        })
        .collect()
}

/// Part of the squares of `x` about its mean in each octave, the fastest first.
fn spectrum(mut x: Vec<f64>) -> Vec<f64> {
    let mean = x.iter().sum::<f64>() / x.len().max(1) as f64;
    for x in &mut x {
        *x -= mean;
    }
    let mut octaves = Vec::new();
    let mut width = 3;
    while 4 * width < x.len() {
        let slow = smooth(&x, width);
        octaves.push(
            x.iter()
                .zip(&slow)
                .map(|(x, slow)| (x - slow).powi(2))
                .sum(),
        );
        x = slow;
        width = 2 * width + 1;
    }
    octaves.push(x.iter().map(|x| x * x).sum());
    let total: f64 = octaves.iter().sum();
    let part = |o: f64| o / total.max(1e-300);
    octaves.into_iter().map(part).collect()
}

/// `spectrum` with harmonics up to two octaves higher, as a distorted model causes.
fn harmonic_spread(spectrum: &[f64]) -> Vec<f64> {
    let slower = |b: usize| spectrum[b..].iter().take(3);
    (0..spectrum.len()).map(|b| slower(b).sum()).collect()
}

/// Most of the squares of something with the spectrum `a` that what has the spectrum `b` can be
/// taken for, whatever its phases.
fn spectral_overlap(a: &[f64], b: &[f64]) -> f64 {
    let along: f64 = a.iter().zip(b).map(|(a, b)| (a * b).sqrt()).sum();
    along.min(1.0).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_in_one_ratio_are_proportional() {
        let of = |values: [f64; 3]| values.map(|value| vec![value]).to_vec();
        let evidence = [100.0, 200.0, 1.0];
        let found = of([0.10, -0.12, 0.15]);
        // The third gauge shows next to nothing.
        assert!(are_proportional(&of([5.0, -6.3, 0.0]), &found, &evidence));
        assert!(!are_proportional(&of([5.0, 6.3, 7.5]), &found, &evidence));
        assert!(!are_proportional(&of([5.0, -8.0, 7.5]), &found, &evidence));
        let elsewhere = [vec![0.1], vec![], vec![]];
        assert!(!are_proportional(
            &of([5.0, 6.0, 0.0]),
            &elsewhere,
            &evidence
        ));
        let one = [100.0, 1.0, 1.0];
        assert!(!are_proportional(&of([5.0, -6.3, 0.0]), &found, &one));
    }

    #[test]
    fn what_is_left_is_known_only_roughly() {
        assert!((remaining_excess(3.0, 1.0) - 1.0).abs() < 1e-12);
        assert!(remaining_excess(3.0, 3.0).abs() < 1e-12);
        assert!(clears_excess(3.0, 2.2) && !clears_excess(3.0, 1.9));
        assert!(clears_excess(0.46, 0.36) && !clears_excess(0.46, 0.30));
        assert!(!clears_excess(0.1, 0.1));
    }
}
