//! Which effects: one after another, the best that is significant, then
//! without those that became superfluous.

use rayon::prelude::*;

use super::columns::{base_columns, columns};
use super::effect::Effect;
use super::fit::{Base, Data, Trial};
use super::null::Draws;
use super::observed::Observed;
use super::refit::{refit, rest};
use super::shape::best_shape;
use super::stream::{Columns, Session};

/// Chance of an effect being named where there is none, over all candidates.
const FALSE_ALARM: f64 = 0.005;

/// Evidence below which nothing is named, whatever the draws say.
const LEAST: f64 = 16.0;

/// Part of the evidence by which two forms of the same may differ.
const SAME: f64 = 0.001;

/// Part of what is left of a residual that an effect must explain somewhere:
/// what a simulated clean machine leaves is not known better.
const MATERIAL: f64 = 0.05;

/// The same of an effect with a signal that is free to explain anything.
const MATERIAL_OF_LATENT: f64 = 0.15;

/// Most effects that are named.
const MOST: usize = 3;

/// Times that an effect which is not linear is taken about what its fit says.
pub(super) const RELINEARISED: usize = 4;

/// Candidates whose shape is refined.
const REFINED: usize = 6;

/// An effect with its parameters.
#[derive(Clone)]
pub struct Found<S: Observed = Session> {
    /// The effect.
    pub effect: &'static dyn Effect<S>,
    /// Its shape.
    pub shape: Vec<f64>,
    /// Linear parameters of each stream; empty where it does not act.
    pub parameters: Vec<Vec<f64>>,
    /// Logarithm of the evidence on left-out blocks.
    pub evidence: f64,
    /// What would have been evidence enough.
    pub threshold: f64,
    /// Evidence of each stream.
    pub streams: Vec<f64>,
    /// By how much what each stream says of shared parameters spreads more than
    /// its noise.
    pub overdispersion: Vec<f64>,
    /// Other shapes that explain the same.
    pub elsewhere: Vec<Vec<f64>>,
}

/// A candidate with its evidence.
#[derive(Clone)]
pub struct Ranked<S: Observed = Session> {
    /// The effect.
    pub effect: &'static dyn Effect<S>,
    /// Its best trial.
    pub trial: Trial,
    /// Evidence that chance alone does not reach.
    pub threshold: f64,
    /// The most that each draw without effect reaches with any shape.
    null: Vec<f64>,
    /// Shapes elsewhere on the grid that explain the same.
    elsewhere: Vec<Vec<f64>>,
}

impl<S: Observed> Ranked<S> {
    /// Evidence beyond what the machine without effect shows.
    pub fn margin(&self) -> f64 {
        self.trial.score - self.threshold
    }

    /// How many numbers it may choose.
    fn parameters(&self) -> usize {
        self.effect.linear().len() + self.effect.shape().len()
    }
}

/// What the search came to.
pub struct Selection<S: Observed = Session> {
    /// Effects, the first found first.
    pub found: Vec<Found<S>>,
    /// All candidates for the first effect, the best first.
    pub ranking: Vec<Ranked<S>>,
    /// Candidates that the data cannot tell from the first one.
    pub alike: Vec<Ranked<S>>,
    /// Nuisance parameters of each stream (zero first).
    pub nuisance: Vec<Vec<f64>>,
    /// Residuals after everything found: `[session][stream]`.
    pub rest: Vec<Vec<Vec<f64>>>,
}

impl<S: Observed> Selection<S> {
    /// Keeps of the further effects those that explain recordings which took
    /// no part in the search.
    pub fn confirm(&mut self, sessions: &[S], unseen: &[S]) {
        let mut kept: Vec<Found<S>> = Vec::new();
        for found in &self.found {
            let mut with = kept.clone();
            with.push(found.clone());
            let helps = kept.is_empty()
                || !found.effect.lasts()
                || size(sessions, unseen, &with) < size(sessions, unseen, &kept);
            if helps {
                kept = with;
            }
        }
        if kept.len() < self.found.len() {
            self.nuisance = refit(sessions, &mut kept, None);
            self.rest = rest(sessions, &kept, &self.nuisance);
            self.found = kept;
        }
    }
}

/// Half the logarithm of the mean squares that are left of `unseen`, each as
/// often as it has independent samples.
fn size<S: Observed>(sessions: &[S], unseen: &[S], found: &[Found<S>]) -> f64 {
    let mut found: Vec<Found<S>> = found.iter().filter(|f| f.effect.lasts()).cloned().collect();
    let nuisance = refit(sessions, &mut found, None);
    unseen
        .iter()
        .zip(rest(unseen, &found, &nuisance))
        .flat_map(|(session, rest)| {
            rest.into_iter().enumerate().map(|(k, rest)| {
                let known = rest.iter().filter(|r| r.is_finite());
                let n = known.clone().count().max(1) as f64;
                // Zeros differ from recording to recording.
                let mean = known.clone().sum::<f64>() / n;
                let square = known.map(|r| (r - mean).powi(2)).sum::<f64>() / n;
                0.5 * n / session.inflation(k) * square.max(1e-300).ln()
            })
        })
        .sum()
}

/// Searches `candidates` for what explains the residuals of `sessions`.
pub fn select<S: Observed>(
    sessions: &[S],
    draws: &Draws,
    candidates: &[&'static dyn Effect<S>],
    progress: impl Fn(f64),
) -> Selection<S> {
    let mut data = Data::new(sessions, draws);
    let mut found: Vec<Found<S>> = Vec::new();
    let mut ranking = Vec::new();
    let mut alike = Vec::new();
    let mut working = sessions.to_vec();
    for round in 0..MOST {
        let base = data.base(base_columns(sessions, &found));
        let left: Vec<&'static dyn Effect<S>> = candidates
            .iter()
            .copied()
            .filter(|e| !found.iter().any(|f| f.effect.name() == e.name()))
            .collect();
        let mut ranked = rank(&data, &base, &working, &left);
        progress((round as f64 + 0.7) / MOST as f64);
        refine(&data, &base, &working, &mut ranked, left.len());
        let accepted = simplest(
            ranked
                .iter()
                .filter(|r| r.margin() > 0.0 && is_material(&data, sessions, r))
                .filter(|r| brings_more(&data, r, &found)),
        )
        .cloned();
        if round == 0 {
            ranking.clone_from(&ranked);
        }
        let Some(best) = accepted else { break };
        if round == 0 {
            alike = ranked
                .iter()
                .filter(|other| other.effect.name() != best.effect.name())
                .filter(|other| other.parameters() <= best.parameters())
                .filter(|other| is_material(&data, sessions, other) && indistinct(&best, other))
                .cloned()
                .collect();
        }
        found.push(Found {
            effect: best.effect,
            shape: best.trial.shape.clone(),
            parameters: best.trial.about.clone(),
            evidence: best.trial.score,
            threshold: best.threshold,
            streams: best.trial.streams.clone(),
            overdispersion: best.trial.overdispersion.clone(),
            elsewhere: best.elsewhere.clone(),
        });
        refit(sessions, &mut found, Some(&best.trial.streams));
        settle(&data, sessions, &mut found);
        let nuisance = refit(sessions, &mut found, None);
        for (session, rest) in working.iter_mut().zip(rest(sessions, &found, &nuisance)) {
            for (k, rest) in rest.into_iter().enumerate() {
                session.set_residual(k, rest);
            }
        }
        data = Data::new(sessions, draws);
    }
    let nuisance = refit(sessions, &mut found, None);
    let rest = rest(sessions, &found, &nuisance);
    progress(1.0);
    Selection {
        found,
        ranking,
        alike,
        nuisance,
        rest,
    }
}

/// Whether a candidate explains a part of some residual that is worth a name.
fn is_material<S: Observed>(data: &Data, sessions: &[S], candidate: &Ranked<S>) -> bool {
    let is_latent = sessions.iter().any(|s| candidate.effect.latent(s) > 0.0);
    let least = if is_latent {
        MATERIAL_OF_LATENT
    } else {
        MATERIAL
    };
    let trial = &candidate.trial;
    let gains = trial.streams.iter().zip(&trial.overdispersion);
    gains
        .enumerate()
        .any(|(k, (gain, over))| (2.0 * gain / over / data.independent(k)).exp() > 1.0 + least)
}

/// Whether a candidate explains more, in the streams on which it acts, than a
/// form that is not quite right leaves of the effects found before; in squares
/// over what is left in the end.
fn brings_more<S: Observed>(data: &Data, candidate: &Ranked<S>, found: &[Found<S>]) -> bool {
    let (mut brought, mut before) = (0.0, 0.0);
    for (k, gain) in candidate.trial.streams.iter().enumerate() {
        if *gain > 0.02 * candidate.trial.score {
            let n = data.independent(k);
            let ratio = |gain: f64| (2.0 * gain / n).exp();
            brought += n * (ratio(*gain) - 1.0);
            let mut later = ratio(*gain);
            for f in found.iter().rev() {
                let own = ratio(f.streams[k].max(0.0));
                before += f.effect.form().powi(2) * n * (own - 1.0) * later;
                later *= own;
            }
        }
    }
    brought > before
}

/// The first of `ranked`, or one that explains the same with fewer parameters:
/// a gauge that came loose before the recording began has another gain.
fn simplest<'a, S: Observed>(ranked: impl Iterator<Item = &'a Ranked<S>>) -> Option<&'a Ranked<S>> {
    let mut ranked = ranked.peekable();
    let best = ranked.peek()?.trial.score;
    ranked
        .filter(|r| r.trial.score > best - LEAST.max(SAME * best))
        .min_by_key(|r| r.parameters())
}

/// Whether what tells `other` from `best` could be chance.
fn indistinct<S: Observed>(best: &Ranked<S>, other: &Ranked<S>) -> bool {
    let gap = best.margin() - other.margin();
    other.margin() > 0.0 && gap < same(best.margin())
}

/// Candidates on the grid of their shapes, the best evidence first; without
/// those that the recording cannot show.
fn rank<S: Observed>(
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
        .par_iter()
        .filter_map(|(i, shape)| {
            let effect = candidates[*i];
            let linear = columns(sessions, effect, shape, &[]);
            if linear.iter().flatten().all(Vec::is_empty) {
                return None;
            }
            let mut trial = data.trial(base, effect, shape, &linear, None);
            if !effect.is_linear() {
                let bent = relinearised(data, base, sessions, effect, &trial, linear);
                if bent.score > trial.score {
                    trial = bent;
                }
            }
            charge(effect, sessions, &mut trial);
            Some((*i, trial))
        })
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
            threshold: by_chance(best, &null, candidates.len()),
            null,
            elsewhere: elsewhere(*effect, &sessions[0], best, &own),
        });
    }
    ranked.sort_by(|a, b| b.margin().total_cmp(&a.margin()));
    ranked
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
fn same(evidence: f64) -> f64 {
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
    linear: Vec<Columns>,
) -> Trial {
    let shape = &at_first.shape;
    let mut about = Vec::new();
    let mut terms = linear;
    for _ in 0..RELINEARISED {
        about = data.parameters(base, effect, &terms, &at_first.overdispersion);
        terms = columns(sessions, effect, shape, &about);
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
fn by_chance(trial: &Trial, draws: &[f64], candidates: usize) -> f64 {
    const ROUGHLY: f64 = 2.0;
    let tempered = (ROUGHLY * gumbel(draws, FALSE_ALARM / candidates as f64)).max(LEAST);
    if trial.tempered > 0.0 {
        tempered * (trial.score / trial.tempered).max(1.0)
    } else {
        f64::MAX
    }
}

/// Takes from the evidence what latent degrees of freedom cost; a signal that is free to
/// explain anything has to explain twice as much.
fn charge<S: Observed>(effect: &dyn Effect<S>, sessions: &[S], trial: &mut Trial) {
    let latent: f64 = sessions.iter().map(|s| effect.latent(s)).sum();
    if latent > 0.0 {
        let samples: f64 = sessions.iter().map(|s| s.speed().len() as f64).sum();
        let cost = 0.5 * latent * samples.ln();
        trial.score = 0.5 * (trial.score - cost);
        trial.tempered = 0.5 * (trial.tempered - cost);
    }
}

/// The value that an extreme-value distribution with the draws' mean and
/// standard deviation exceeds with `probability`.
fn gumbel(draws: &[f64], probability: f64) -> f64 {
    let n = draws.len() as f64;
    if n < 2.0 {
        return 0.0;
    }
    let mean = draws.iter().sum::<f64>() / n;
    let variance = draws.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let width = (6.0 * variance).sqrt() / std::f64::consts::PI;
    mean - 0.577_2 * width - width * (-(1.0 - probability).ln()).ln()
}

/// Refines the shapes of the best candidates by a pattern search; draws without
/// effect may take the shape found as well.
fn refine<S: Observed>(
    data: &Data,
    base: &Base,
    sessions: &[S],
    ranked: &mut [Ranked<S>],
    candidates: usize,
) {
    let best = ranked.first().map_or(0.0, Ranked::margin);
    ranked
        .par_iter_mut()
        .take(REFINED)
        .filter(|r| r.margin() > 0.1 * best && r.trial.score > 0.5 * r.threshold)
        .for_each(|candidate| {
            let effect = candidate.effect;
            let at_first = candidate.trial.clone();
            let shape = best_shape(data, base, sessions, effect, at_first);
            if shape == candidate.trial.shape {
                return;
            }
            let columns = columns(sessions, effect, &shape, &[]);
            candidate.trial = data.trial(base, effect, &shape, &columns, None);
            charge(effect, sessions, &mut candidate.trial);
            for (most, here) in candidate.null.iter_mut().zip(&candidate.trial.null) {
                *most = most.max(*here);
            }
            candidate.threshold = by_chance(&candidate.trial, &candidate.null, candidates);
        });
    ranked.sort_by(|a, b| b.margin().total_cmp(&a.margin()));
}

/// Takes out effects without which the evidence is hardly less; the others take
/// the shape that is best beside the rest.
fn settle<S: Observed>(data: &Data, sessions: &[S], found: &mut Vec<Found<S>>) {
    let mut i = 0;
    while found.len() > 1 && i < found.len() {
        let others: Vec<Found<S>> = found
            .iter()
            .enumerate()
            .filter(|(j, _)| *j != i)
            .map(|(_, f)| f.clone())
            .collect();
        let base = data.base(base_columns(sessions, &others));
        let f = &mut found[i];
        let columns = columns(sessions, f.effect, &f.shape, &f.parameters);
        let trial = data.trial(&base, f.effect, &f.shape, &columns, Some(&f.overdispersion));
        if trial.score < f.threshold {
            found.remove(i);
        } else {
            f.shape = best_shape(data, &base, sessions, f.effect, trial);
            i += 1;
        }
    }
}
