//! Candidates with their evidence: on the grid of their shapes, then refined.

use std::borrow::Cow;
use std::cmp::Ordering;

use rayon::prelude::*;

use super::columns::columns;
use super::effect::Effect;
use super::fit::{Base, Data};
use super::observed::Observed;
use super::shape::best_shape;
use super::statistics::gumbel;
use super::stream::{Columns, Session};
use super::trial::{Trial, Tried};

/// Chance of an effect being named where there is none, over all candidates.
const FALSE_ALARM: f64 = 0.005;

/// Evidence below which nothing is named, whatever the draws say: by chance alone each of a hundred
/// candidates and shapes reaches it with a probability of `FALSE_ALARM` over a hundred, ln(100 / 0.005).
pub(super) const LEAST: f64 = 10.0;

/// Times that an effect which is not linear is taken about what its fit says.
pub(super) const RELINEARISED: usize = 4;

/// Candidates that are held against the data at a time.
const TOGETHER: usize = 4;

/// Candidates whose shape is refined.
const REFINED: usize = 6;

/// A candidate with its evidence.
#[derive(Clone)]
pub struct Ranked<S: Observed = Session> {
    /// The effect.
    pub effect: &'static dyn Effect<S>,
    /// Its best trial.
    pub trial: Trial,
    /// Linear parameters of each stream; empty where it does not act.
    pub parameters: Vec<Vec<f64>>,
    /// Evidence that chance alone does not reach; none where the tempered evidence is not above 0,
    /// which chance always reaches.
    pub threshold: Option<f64>,
    /// The most that each draw without effect reaches with any shape.
    null: Vec<f64>,
    /// Shapes elsewhere on the grid that explain the same.
    pub(super) elsewhere: Vec<Vec<f64>>,
}

impl<S: Observed> Ranked<S> {
    /// Evidence beyond what the machine without effect shows; none without a threshold.
    pub fn margin(&self) -> Option<f64> {
        self.threshold.map(|threshold| self.trial.score - threshold)
    }

    /// Whether the evidence is more than chance reaches.
    pub(super) fn exceeds_chance(&self) -> bool {
        self.margin().is_some_and(|margin| margin > 0.0)
    }

    /// The largest margin first, those without one last.
    pub(super) fn by_margin(&self, other: &Self) -> Ordering {
        match (self.margin(), other.margin()) {
            (Some(own), Some(other)) => other.total_cmp(&own),
            (own, other) => other.is_some().cmp(&own.is_some()),
        }
    }
}

/// Candidates on the grid of their shapes, the best evidence first; without
/// those that the recording cannot show.
pub(super) fn rank<S: Observed>(
    data: &Data,
    base: &Base,
    sessions: &[S],
    candidates: &[&'static dyn Effect<S>],
) -> Vec<Ranked<S>> {
    let jobs: Vec<(usize, Vec<f64>)> = candidates
        .iter()
        .enumerate()
        .flat_map(|(i, effect)| {
            effect
                .grid(&sessions[0])
                .into_iter()
                .map(move |shape| (i, shape))
        })
        .collect();
    let trials: Vec<(usize, Trial)> = jobs
        .par_chunks(TOGETHER)
        .flat_map_iter(|jobs| tried(data, base, sessions, candidates, jobs))
        .collect();
    let mut ranked: Vec<Ranked<S>> = Vec::new();
    for (i, effect) in candidates.iter().enumerate() {
        let own: Vec<&Trial> = trials
            .iter()
            .filter(|(j, _)| *j == i)
            .map(|(_, t)| t)
            .collect();
        let Some(best) = own.iter().max_by(|a, b| a.score.total_cmp(&b.score)) else {
            continue;
        };
        let null: Vec<f64> = (0..best.null.len())
            .map(|m| own.iter().map(|t| t.null[m]).fold(0.0, f64::max))
            .collect();
        ranked.push(Ranked {
            effect: *effect,
            trial: (*best).clone(),
            parameters: Vec::new(),
            threshold: by_chance(best, &null, candidates.len()),
            null,
            elsewhere: elsewhere(*effect, &sessions[0], best, &own),
        });
    }
    ranked.sort_by(Ranked::by_margin);
    ranked
}

/// What each of `jobs`, a candidate's number and a shape, explains; without those that the recording
/// cannot show.
fn tried<S: Observed>(
    data: &Data,
    base: &Base,
    sessions: &[S],
    candidates: &[&'static dyn Effect<S>],
    jobs: &[(usize, Vec<f64>)],
) -> Vec<(usize, Trial)> {
    let mut terms: Vec<Vec<Columns>> = Vec::new();
    let mut shown = Vec::new();
    for (i, shape) in jobs {
        let linear = columns(sessions, candidates[*i], shape, &[]);
        if !linear.iter().flatten().all(Vec::is_empty) {
            terms.push(linear);
            shown.push((*i, candidates[*i], shape.as_slice()));
        }
    }
    let bases: Vec<Cow<'_, Base>> = (shown.iter())
        .map(|(_, effect, shape)| data.with_nuisances(base, sessions, *effect, shape))
        .collect();
    let all: Vec<Tried<'_, S>> = (shown.iter().zip(&bases).zip(&terms))
        .map(|(((_, effect, shape), base), columns)| Tried {
            base,
            effect: *effect,
            shape,
            columns,
        })
        .collect();
    let mut trials = data.trials(&all);
    for (trial, tried) in trials.iter_mut().zip(&all) {
        let effect = tried.effect;
        if !effect.is_linear() {
            let bent = relinearised(data, tried.base, sessions, effect, trial, tried.columns);
            if bent.score > trial.score {
                *trial = bent;
            }
        }
        charge(effect, sessions, trial);
    }
    shown.iter().map(|(i, ..)| *i).zip(trials).collect()
}

/// Shapes of which each is a place of its own, and that explain what `best` explains.
fn elsewhere<S: Observed>(
    effect: &dyn Effect<S>,
    session: &S,
    best: &Trial,
    trials: &[&Trial],
) -> Vec<Vec<f64>> {
    let separate = effect.shape().iter().all(|parameter| parameter.step == 0.0);
    let gap = |trial: &Trial| best.score - trial.score;
    (trials.iter().filter(|_| separate))
        .filter(|trial| effect.place(session, &trial.shape) != effect.place(session, &best.shape))
        .filter(|trial| gap(trial) < same(best.score))
        .map(|trial| trial.shape.clone())
        .collect()
}

/// Evidence by which two that explain the same may differ by chance.
pub(super) fn same(evidence: f64) -> f64 {
    4.0_f64.max(0.002 * evidence)
}

/// A trial of an effect that is not linear in its parameters: its terms are
/// taken about what the fit says, in turn.
fn relinearised<S: Observed>(
    data: &Data,
    base: &Base,
    sessions: &[S],
    effect: &dyn Effect<S>,
    at_first: &Trial,
    linear: &[Columns],
) -> Trial {
    let shape = &at_first.shape;
    let mut about = Vec::new();
    let mut terms = Cow::Borrowed(linear);
    for _ in 0..RELINEARISED {
        about = data.parameters(base, effect, &terms, &at_first.overdispersion);
        terms = columns(sessions, effect, shape, &about).into();
    }
    Trial {
        about,
        ..data.trial(base, effect, shape, &terms, None)
    }
}

/// Evidence that a machine without the effect hardly reaches: tempered as that of the
/// `draws`, and as much more as that of `trial` is without.
///
/// The draws know the power of what a clean machine leaves only within a
/// factor, taken as two; evidence is in proportion to it.
fn by_chance(trial: &Trial, draws: &[f64], candidates: usize) -> Option<f64> {
    const ROUGHLY: f64 = 2.0;
    let tempered = (ROUGHLY * gumbel(draws, FALSE_ALARM / candidates as f64)).max(LEAST);
    (trial.tempered > 0.0).then(|| tempered * (trial.score / trial.tempered).max(1.0))
}

/// Takes from the evidence what latent degrees of freedom cost; a signal that is free to
/// explain anything has to explain twice as much.
pub(super) fn charge<S: Observed>(effect: &dyn Effect<S>, sessions: &[S], trial: &mut Trial) {
    let latent: f64 = sessions.iter().map(|s| effect.latent(s)).sum();
    if latent > 0.0 {
        let samples: f64 = sessions.iter().map(|s| s.speed().len() as f64).sum();
        let cost = 0.5 * latent * samples.ln();
        trial.score = 0.5 * (trial.score - cost);
        trial.tempered = 0.5 * (trial.tempered - cost);
    }
}

/// Refines the shapes of the best candidates by a pattern search; draws without
/// effect may take the shape found as well.
pub(super) fn refine<S: Observed>(
    data: &Data,
    base: &Base,
    sessions: &[S],
    ranked: &mut [Ranked<S>],
    candidates: usize,
) {
    let best = ranked.first().and_then(Ranked::margin).unwrap_or(0.0);
    ranked
        .par_iter_mut()
        .take(REFINED)
        .filter(|r| {
            let promising = |threshold| {
                r.trial.score - threshold > 0.1 * best && r.trial.score > 0.5 * threshold
            };
            r.threshold.is_some_and(promising)
        })
        .for_each(|candidate| {
            let effect = candidate.effect;
            let at_first = candidate.trial.clone();
            let shape = best_shape(data, base, sessions, effect, at_first);
            if shape == candidate.trial.shape {
                return;
            }
            let columns = columns(sessions, effect, &shape, &[]);
            let base = &data.with_nuisances(base, sessions, effect, &shape);
            candidate.trial = data.trial(base, effect, &shape, &columns, None);
            charge(effect, sessions, &mut candidate.trial);
            for (most, here) in candidate.null.iter_mut().zip(&candidate.trial.null) {
                *most = most.max(*here);
            }
            candidate.threshold = by_chance(&candidate.trial, &candidate.null, candidates);
        });
    for r in ranked.iter_mut().filter(|r| r.exceeds_chance()) {
        let columns = columns(sessions, r.effect, &r.trial.shape, &r.trial.about);
        let base = &data.with_nuisances(base, sessions, r.effect, &r.trial.shape);
        r.parameters = data.parameters(base, r.effect, &columns, &r.trial.overdispersion);
    }
    ranked.sort_by(Ranked::by_margin);
}
