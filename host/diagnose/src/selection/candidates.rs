//! Ranks candidate effects by log-evidence above a threshold from the null samples: all on a grid
//! of nonlinear parameters, the best refined by search.

use std::borrow::Cow;
use std::cmp::Ordering;

use rayon::prelude::*;

use crate::candidate_effect::Effect;
use crate::candidate_effect::fitted::FittedEffect;
use crate::regression::cross_validation::{BaseModel, RegressionData};
use crate::regression::design_matrix::{GAUSS_NEWTON_STEPS, columns};
use crate::residual_model::Columns;
use crate::residual_model::ResidualModel;
use crate::sample_statistics::gumbel_quantile;
use crate::selection::parameter_search::search_parameters;
use crate::selection::score::{Candidate, CandidateScore};

/// Chance of an effect being named where there is none, over all candidates.
const FALSE_ALARM: f64 = 0.005;

/// Smallest threshold [log-evidence], whatever the null samples: by chance each of a hundred
/// candidates and shapes reaches it with a probability of `FALSE_ALARM` over a hundred, ln(100 /
/// 0.005). With 16 more weak effects were missed (seeds 239 and 241, docs/lab/results.md).
pub(crate) const MIN_LOG_EVIDENCE: f64 = 10.0;

/// Candidates that are held against the data at a time.
const BATCH: usize = 4;

/// Candidates whose shape is refined.
const REFINE_TOP: usize = 6;

/// A candidate with its evidence.
#[derive(Clone)]
pub struct RankedCandidate<S: ResidualModel> {
    /// The effect.
    pub effect: &'static dyn Effect<S>,
    /// Its best trial.
    pub score: CandidateScore,
    /// Linear parameters of each signal; empty where it does not act.
    pub parameters: Vec<Vec<f64>>,
    /// Evidence that chance alone does not reach; none where the tempered evidence is not above 0,
    /// which chance always reaches.
    pub threshold: Option<f64>,
    /// The largest log-evidence of each null sample over all nonlinear parameters.
    null: Vec<f64>,
    /// Shapes elsewhere on the grid that explain the same.
    pub(crate) equivalent_locations: Vec<Vec<f64>>,
}

impl<S: ResidualModel> RankedCandidate<S> {
    /// Evidence beyond what the machine without effect shows; none without a threshold.
    pub fn margin(&self) -> Option<f64> {
        self.threshold
            .map(|threshold| self.score.log_evidence - threshold)
    }

    /// Whether the evidence is more than chance reaches.
    pub(crate) fn exceeds_chance(&self) -> bool {
        self.margin().is_some_and(|margin| margin > 0.0)
    }

    /// The largest margin first, those without one last.
    pub(crate) fn by_margin(&self, other: &Self) -> Ordering {
        match (self.margin(), other.margin()) {
            (Some(own), Some(other)) => other.total_cmp(&own),
            (own, other) => other.is_some().cmp(&own.is_some()),
        }
    }
}

/// Candidates on the grid of their shapes, the largest margin first; without
/// those that the recording cannot show.
pub(crate) fn rank<S: ResidualModel>(
    data: &RegressionData,
    base: &BaseModel,
    recordings: &[S],
    candidates: &[&'static dyn Effect<S>],
) -> Vec<RankedCandidate<S>> {
    let jobs: Vec<(usize, Vec<f64>)> = candidates
        .iter()
        .enumerate()
        .flat_map(|(i, effect)| {
            effect
                .initial_values(&recordings[0])
                .into_iter()
                .map(move |shape| (i, shape))
        })
        .collect();
    let trials: Vec<(usize, CandidateScore)> = jobs
        .par_chunks(BATCH)
        .flat_map_iter(|jobs| evaluate_batch(data, base, recordings, candidates, jobs))
        .collect();
    let mut ranked: Vec<RankedCandidate<S>> = Vec::new();
    for (i, effect) in candidates.iter().enumerate() {
        let own: Vec<&CandidateScore> = trials
            .iter()
            .filter(|(j, _)| *j == i)
            .map(|(_, t)| t)
            .collect();
        let Some(best) = own
            .iter()
            .max_by(|a, b| a.log_evidence.total_cmp(&b.log_evidence))
        else {
            continue;
        };
        let null: Vec<f64> = (0..best.null.len())
            .map(|m| own.iter().map(|t| t.null[m]).fold(0.0, f64::max))
            .collect();
        ranked.push(RankedCandidate {
            effect: *effect,
            score: (*best).clone(),
            parameters: Vec::new(),
            threshold: significance_threshold(best, &null, candidates.len()),
            null,
            equivalent_locations: equivalent_locations(*effect, &recordings[0], best, &own),
        });
    }
    ranked.sort_by(RankedCandidate::by_margin);
    ranked
}

/// What each of `jobs`, a candidate's number and a shape, explains; without those that the recording
/// cannot show.
fn evaluate_batch<S: ResidualModel>(
    data: &RegressionData,
    base: &BaseModel,
    recordings: &[S],
    candidates: &[&'static dyn Effect<S>],
    jobs: &[(usize, Vec<f64>)],
) -> Vec<(usize, CandidateScore)> {
    let mut terms: Vec<Vec<Columns>> = Vec::new();
    let mut shown = Vec::new();
    for (i, shape) in jobs {
        let linear = columns(recordings, candidates[*i], shape, &[]);
        if !linear.iter().flatten().all(Vec::is_empty) {
            terms.push(linear);
            shown.push((*i, candidates[*i], shape.as_slice()));
        }
    }
    let bases: Vec<Cow<'_, BaseModel>> = (shown.iter())
        .map(|(_, effect, shape)| data.with_nuisances(base, recordings, *effect, shape))
        .collect();
    let all: Vec<Candidate<'_, S>> = (shown.iter().zip(&bases).zip(&terms))
        .map(|(((_, effect, shape), base), columns)| Candidate {
            base,
            effect: *effect,
            shape,
            columns,
        })
        .collect();
    let mut trials = data.trials(&all);
    for (trial, evaluate_batch) in trials.iter_mut().zip(&all) {
        let effect = evaluate_batch.effect;
        if !effect.is_linear() {
            let bent = gauss_newton(
                data,
                evaluate_batch.base,
                recordings,
                effect,
                trial,
                evaluate_batch.columns,
            );
            if bent.log_evidence > trial.log_evidence {
                *trial = bent;
            }
        }
        penalise_latent(effect, recordings, trial);
    }
    shown.iter().map(|(i, ..)| *i).zip(trials).collect()
}

/// Shapes of which each is a place of its own, and that explain what `best` explains.
fn equivalent_locations<S: ResidualModel>(
    effect: &dyn Effect<S>,
    recording: &S,
    best: &CandidateScore,
    trials: &[&CandidateScore],
) -> Vec<Vec<f64>> {
    let separate = effect
        .nonlinear_parameters()
        .iter()
        .all(|parameter| parameter.step == 0.0);
    let gap = |trial: &CandidateScore| best.log_evidence - trial.log_evidence;
    (trials.iter().filter(|_| separate))
        .filter(|trial| {
            effect.location(recording, &trial.shape) != effect.location(recording, &best.shape)
        })
        .filter(|trial| gap(trial) < tie_tolerance(best.log_evidence))
        .map(|trial| trial.shape.clone())
        .collect()
}

/// Evidence by which two that explain the same may differ by chance.
pub(crate) fn tie_tolerance(evidence: f64) -> f64 {
    4.0_f64.max(0.002 * evidence)
}

/// A trial of an effect that is not linear in its parameters: its terms are
/// linearised about the fitted parameters, repeatedly.
fn gauss_newton<S: ResidualModel>(
    data: &RegressionData,
    base: &BaseModel,
    recordings: &[S],
    effect: &dyn Effect<S>,
    at_first: &CandidateScore,
    linear: &[Columns],
) -> CandidateScore {
    let shape = &at_first.shape;
    let mut linearised_at = Vec::new();
    let mut terms = Cow::Borrowed(linear);
    for _ in 0..GAUSS_NEWTON_STEPS {
        linearised_at = data.parameters(base, effect, &terms, &at_first.overdispersion);
        terms = columns(recordings, effect, shape, &linearised_at).into();
    }
    CandidateScore {
        linearised_at,
        ..data.trial(base, effect, shape, &terms, None)
    }
}

/// Evidence that a machine without the effect hardly reaches: tempered as that of the
/// `null_samples`, and as much more as that of `trial` is without.
///
/// The null samples give the residual power of a fault-free machine only within a
/// factor, assumed as two; evidence is in proportion to it.
fn significance_threshold(
    trial: &CandidateScore,
    null_samples: &[f64],
    candidates: usize,
) -> Option<f64> {
    /// Factor by which the residual power of a fault-free machine may exceed that of the null
    /// samples, assumed.
    const NULL_POWER_FACTOR: f64 = 2.0;
    let tempered = (NULL_POWER_FACTOR
        * gumbel_quantile(null_samples, FALSE_ALARM / candidates as f64))
    .max(MIN_LOG_EVIDENCE);
    (trial.log_evidence_tempered > 0.0)
        .then(|| tempered * (trial.log_evidence / trial.log_evidence_tempered).max(1.0))
}

/// Subtracts the cost of latent degrees of freedom from the evidence; a free signal has to
/// explain twice as much.
pub(crate) fn penalise_latent<S: ResidualModel>(
    effect: &dyn Effect<S>,
    recordings: &[S],
    trial: &mut CandidateScore,
) {
    let free_degrees: f64 = recordings.iter().map(|s| effect.free_degrees(s)).sum();
    if free_degrees > 0.0 {
        let samples: f64 = recordings.iter().map(|s| s.speed().len() as f64).sum();
        let cost = 0.5 * free_degrees * samples.ln();
        trial.log_evidence = 0.5 * (trial.log_evidence - cost);
        trial.log_evidence_tempered = 0.5 * (trial.log_evidence_tempered - cost);
    }
}

/// Refines the shapes of the best candidates by a pattern search; null samples without
/// effect may take the shape found as well.
pub(crate) fn refine_nonlinear<S: ResidualModel>(
    data: &RegressionData,
    base: &BaseModel,
    recordings: &[S],
    ranked: &mut [RankedCandidate<S>],
    candidates: usize,
) {
    let best = ranked
        .first()
        .and_then(RankedCandidate::margin)
        .unwrap_or(0.0);
    ranked
        .par_iter_mut()
        .take(REFINE_TOP)
        .filter(|r| {
            let promising = |threshold| {
                r.score.log_evidence - threshold > 0.1 * best
                    && r.score.log_evidence > 0.5 * threshold
            };
            r.threshold.is_some_and(promising)
        })
        .for_each(|candidate| {
            let effect = candidate.effect;
            let at_first = candidate.score.clone();
            let shape = search_parameters(data, base, recordings, effect, at_first);
            if shape == candidate.score.shape {
                return;
            }
            let columns = columns(recordings, effect, &shape, &[]);
            let base = &data.with_nuisances(base, recordings, effect, &shape);
            candidate.score = data.trial(base, effect, &shape, &columns, None);
            penalise_latent(effect, recordings, &mut candidate.score);
            for (most, here) in candidate.null.iter_mut().zip(&candidate.score.null) {
                *most = most.max(*here);
            }
            candidate.threshold =
                significance_threshold(&candidate.score, &candidate.null, candidates);
        });
    for r in ranked.iter_mut().filter(|r| r.exceeds_chance()) {
        let columns = columns(recordings, r.effect, &r.score.shape, &r.score.linearised_at);
        let base = &data.with_nuisances(base, recordings, r.effect, &r.score.shape);
        r.parameters = data.parameters(base, r.effect, &columns, &r.score.overdispersion);
    }
    ranked.sort_by(RankedCandidate::by_margin);
}

impl<S: ResidualModel> From<RankedCandidate<S>> for FittedEffect<S> {
    fn from(ranked: RankedCandidate<S>) -> Self {
        let RankedCandidate {
            effect,
            score: trial,
            threshold,
            equivalent_locations,
            ..
        } = ranked;
        Self {
            effect,
            shape: trial.shape,
            parameters: trial.linearised_at,
            evidence: trial.log_evidence,
            threshold,
            per_signal: trial.per_signal,
            overdispersion: trial.overdispersion,
            equivalent_locations,
            indistinguishable_from: Vec::new(),
        }
    }
}
