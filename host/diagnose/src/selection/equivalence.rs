//! Chooses the simplest among candidates that explain the data alike, and decides which candidates
//! the data do not distinguish from it.

use std::cmp::Ordering;

use crate::candidate_effect::Effect;
use crate::candidate_effect::fitted::{FittedEffect, is_free_signal};
use crate::regression::cross_validation::RegressionData;
use crate::residual_model::ResidualModel;
use crate::selection::candidates::{MIN_LOG_EVIDENCE, RankedCandidate, tie_tolerance};
use crate::selection::model_error::remaining_excess;

/// Fraction, in squares, that one candidate may explain beyond another and still be equivalent. 2 %
/// was replaced by 1 % with the weak effects of seeds 239 and 241 (docs/lab/results.md).
const EQUIVALENT_SQUARES: f64 = 0.01;

/// The same beside effects found before, which leave model errors, too.
const EQUIVALENT_SQUARES_FURTHER: f64 = 0.05;

/// Log-evidence required for a further parameter, as its value is chosen: chance reaches it once in
/// two thousand times (chi square of one degree of freedom over 12).
const EXTRA_PARAMETER_EVIDENCE: f64 = 6.0;

/// The first of `ranked`, or what explains the same with fewer parameters (a gauge that came
/// loose before the recording began has another gain), of such the first in the library.
pub(crate) fn simplest<'a, S: ResidualModel>(
    data: &RegressionData,
    recordings: &[S],
    ranked: &'a [RankedCandidate<S>],
    found: &[FittedEffect<S>],
) -> Option<&'a RankedCandidate<S>> {
    let best = ranked.first()?;
    let place = |r: &RankedCandidate<S>| {
        let named = |e: &&dyn Effect<S>| e.name() == r.effect.name();
        S::library().iter().position(named)
    };
    ranked
        .iter()
        .filter(|r| is_equivalent(data, recordings, best, r, found))
        .min_by_key(|r| (r.effect.parameter_count(), place(r)))
}

/// Whether `other` explains what `best` does, up to chance or, with fewer parameters, up to
/// a model error: its own, or those of effects `found` before. A signal that is
/// free to explain anything has to explain more than the model error of `best`.
fn is_equivalent<S: ResidualModel>(
    data: &RegressionData,
    recordings: &[S],
    best: &RankedCandidate<S>,
    other: &RankedCandidate<S>,
    found: &[FittedEffect<S>],
) -> bool {
    let gap = best.score.log_evidence - other.score.log_evidence;
    let explained = |r: &RankedCandidate<S>| -> f64 {
        let gains = r.score.per_signal.iter().enumerate();
        gains
            .map(|(k, gain)| data.explained_sum_of_squares(k, *gain))
            .sum()
    };
    let part = if found.is_empty() {
        EQUIVALENT_SQUARES
    } else {
        EQUIVALENT_SQUARES_FURTHER
    };
    let is_free = |r: &RankedCandidate<S>| is_free_signal(recordings, r.effect);
    if is_free(other) && !is_free(best) && !explains_more(data, &recordings[0], best, other) {
        return false;
    }
    match (other.effect.parameter_count()).cmp(&best.effect.parameter_count()) {
        Ordering::Less if ignores_residual(data, best, other) => false,
        Ordering::Less => {
            gap < EXTRA_PARAMETER_EVIDENCE || explained(best) < (1.0 + part) * explained(other)
        }
        Ordering::Equal => gap < tie_tolerance(best.score.log_evidence),
        Ordering::Greater => false,
    }
}

/// Whether the free signal of `other` explains more beyond `best`, in squares over those of a fault-free
/// machine, than twice the model error of `best`.
fn explains_more<S: ResidualModel>(
    data: &RegressionData,
    recording: &S,
    best: &RankedCandidate<S>,
    other: &RankedCandidate<S>,
) -> bool {
    let (mut beyond, mut explained) = (0.0, 0.0);
    for (k, excess) in best.score.excess.iter().enumerate() {
        let left = |r: &RankedCandidate<S>| {
            let explained = data.explained_sum_of_squares(k, r.score.per_signal[k].max(0.0))
                / data.effective_samples(k);
            remaining_excess(*excess, explained)
        };
        beyond += left(best) - left(other);
        explained += excess - left(best);
    }
    beyond > 2.0 * best.effect.model_error(recording).powi(2) * explained
}

/// Whether `other` explains nothing of a residual of which `best` explains more than half.
fn ignores_residual<S: ResidualModel>(
    data: &RegressionData,
    best: &RankedCandidate<S>,
    other: &RankedCandidate<S>,
) -> bool {
    let gains = best.score.per_signal.iter().zip(&other.score.per_signal);
    gains.enumerate().any(|(k, (of_best, of_other))| {
        *of_other <= 0.0
            && *of_best > MIN_LOG_EVIDENCE
            && data.explained_sum_of_squares(k, *of_best) > data.effective_samples(k)
    })
}

/// Whether the recordings do not excite what distinguishes the two: friction that builds
/// up over an angle, where nothing ever stood still.
pub(crate) fn is_identical<S: ResidualModel>(
    best: &RankedCandidate<S>,
    other: &RankedCandidate<S>,
) -> bool {
    /// Difference in log-evidence that is none: a likelihood ratio of 1.05.
    const NOTHING: f64 = 0.05;
    other.effect.is_machine_property()
        && (best.score.log_evidence - other.score.log_evidence).abs() < NOTHING
}

/// Whether the difference between `other` and `best` could be chance.
pub(crate) fn is_tied<S: ResidualModel>(
    best: &RankedCandidate<S>,
    other: &RankedCandidate<S>,
) -> bool {
    let (Some(best), Some(other)) = (best.margin(), other.margin()) else {
        return false;
    };
    other > 0.0 && best - other < tie_tolerance(best)
}
