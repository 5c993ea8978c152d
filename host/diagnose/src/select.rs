//! Which effects: one after another, the best that is significant, then
//! without those that became superfluous.

use std::cmp::Ordering;

use super::columns::{base_columns, columns_of, nuisances, with_effects};
use super::effect::Effect;
use super::fit::{Base, Data};
use super::forms::{Forms, cleared, left};
use super::null::Draws;
use super::observed::Observed;
use super::rank::{LEAST, Ranked, charge, rank, refine, same};
use super::refit::{refit, rest, without};
use super::shape::best_shape;
use super::stream::Session;
use super::trial::Trial;

/// Part, in squares, of what a form explains that another may explain beyond it and still say
/// the same; beside effects found before, whose forms leave something, too.
const SAME: f64 = 0.01;
const SAME_BESIDE: f64 = 0.05;

/// Evidence that a further parameter is asked for, as its value is chosen: chance brings it once in
/// two thousand times (chi square of one degree of freedom over 12).
const FURTHER: f64 = 6.0;

/// Part of what is left of a residual that an effect must explain somewhere:
/// what a simulated clean machine leaves is not known better.
const MATERIAL: f64 = 0.05;

/// The same, given the torque by references, with more than `SURE` times the evidence that chance
/// reaches; beside effects found before, whose forms leave something, too.
const MATERIAL_OF_SURE: f64 = 0.01;
const SURE: f64 = 3.0;
const SURE_BESIDE: f64 = 10.0;

/// The same of an effect with a signal that is free to explain anything.
const MATERIAL_OF_LATENT: f64 = 0.15;

/// Part of the excess over a clean machine that each of several effects explains at least beside the
/// others, where it acts. Where more is left, it takes up what the forms of the others leave.
const OF_EXCESS: f64 = 0.5;

/// Most effects that are named.
const MOST: usize = 3;

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
    /// What would have been evidence enough; none where chance always reaches it.
    pub threshold: Option<f64>,
    /// Evidence of each stream.
    pub streams: Vec<f64>,
    /// By how much what each stream says of shared parameters spreads more than
    /// its noise.
    pub overdispersion: Vec<f64>,
    /// Other shapes that explain the same.
    pub elsewhere: Vec<Vec<f64>>,
    /// Other effects that the data cannot tell from it, by name.
    pub alike: Vec<&'static str>,
}

impl<S: Observed> Found<S> {
    /// Whether the data leave open what it is, or where.
    pub fn is_open(&self) -> bool {
        !(self.elsewhere.is_empty() && self.alike.is_empty())
    }
}

impl<S: Observed> From<Ranked<S>> for Found<S> {
    fn from(ranked: Ranked<S>) -> Self {
        let Ranked {
            effect,
            trial,
            threshold,
            elsewhere,
            ..
        } = ranked;
        Self {
            effect,
            shape: trial.shape,
            parameters: trial.about,
            evidence: trial.score,
            threshold,
            streams: trial.streams,
            overdispersion: trial.overdispersion,
            elsewhere,
            alike: Vec::new(),
        }
    }
}

/// What the search came to.
pub struct Selection<S: Observed = Session> {
    /// Effects, the first found first.
    pub found: Vec<Found<S>>,
    /// All candidates for the first effect, the best first.
    pub ranking: Vec<Ranked<S>>,
    /// Nuisance parameters of each stream (zero first).
    pub nuisance: Vec<Vec<f64>>,
    /// Residuals after everything found: `[session][stream]`.
    pub rest: Vec<Vec<Vec<f64>>>,
}

/// Searches `candidates` for what explains the residuals of `sessions`.
pub fn select<S: Observed>(
    sessions: &[S],
    draws: &Draws,
    candidates: &[&'static dyn Effect<S>],
    progress: impl Fn(f64),
) -> Selection<S> {
    let data = Data::new(sessions, draws);
    let mut found: Vec<Found<S>> = Vec::new();
    let mut ranking = Vec::new();
    for round in 0..MOST {
        let ranked = beside(&data, sessions, &found, candidates);
        progress((round as f64 + 0.7) / MOST as f64);
        let best = chosen(&data, sessions, &ranked, &found);
        if round == 0 {
            ranking = ranked;
        }
        let Some(best) = best else { break };
        found.push(best);
        refit_newest(sessions, &mut found);
        settle(&data, sessions, &mut found);
        exchange(&data, sessions, candidates, &mut found);
    }
    drop_mimics(&data, sessions, &mut found);
    let nuisance = refit(sessions, &mut found, None);
    let rest = rest(sessions, &found, &nuisance);
    let named: Vec<&'static str> = found.iter().map(|f| f.effect.name()).collect();
    for f in &mut found {
        f.alike.retain(|other| !named.contains(other));
    }
    progress(1.0);
    Selection {
        found,
        ranking,
        nuisance,
        rest,
    }
}

/// What of `candidates` explains beside those of `found`, the best evidence first.
fn beside<S: Observed>(
    data: &Data,
    sessions: &[S],
    found: &[Found<S>],
    candidates: &[&'static dyn Effect<S>],
) -> Vec<Ranked<S>> {
    let mut found = found.to_vec();
    let working = if found.is_empty() {
        sessions.to_vec()
    } else {
        let nuisance = refit(sessions, &mut found, None);
        without(sessions, &found, &nuisance)
    };
    let base = data.base(base_columns(sessions, &found));
    let left: Vec<&'static dyn Effect<S>> = candidates
        .iter()
        .copied()
        .filter(|e| !found.iter().any(|f| f.effect.name() == e.name()))
        .collect();
    let mut ranked = rank(data, &base, &working, &left);
    refine(data, &base, &working, &mut ranked, left.len());
    ranked
}

/// The candidate of `ranked` that is significant, worth a name and more than what those of `found`
/// leave, with those that cannot be told from it; its evidence is that which counts.
fn chosen<S: Observed>(
    data: &Data,
    sessions: &[S],
    ranked: &[Ranked<S>],
    found: &[Found<S>],
) -> Option<Found<S>> {
    let forms = Forms::new(data, sessions, found);
    let mut worth: Vec<Ranked<S>> = ranked
        .iter()
        .filter(|r| r.exceeds_chance() && is_material(data, sessions, r, found))
        .filter_map(|r| forms.beyond(r))
        .filter(Ranked::exceeds_chance)
        .collect();
    worth.sort_by(Ranked::by_margin);
    let best = simplest(data, sessions, &worth, found)?;
    let alike = (worth.iter())
        .filter(|other| other.effect.name() != best.effect.name())
        .filter(|other| {
            other.effect.numbers() <= best.effect.numbers() || predicts_the_same(best, other)
        })
        .filter(|other| indistinct(best, other))
        .map(|other| other.effect.name())
        .collect();
    Some(Found {
        alike,
        ..best.clone().into()
    })
}

/// Effects for which another is better, once what was found later is in the model; not beside a
/// signal that is free, which takes what the effect explained as well.
fn exchange<S: Observed>(
    data: &Data,
    sessions: &[S],
    candidates: &[&'static dyn Effect<S>],
    found: &mut Vec<Found<S>>,
) {
    for i in 0..found.len().saturating_sub(1) {
        let mut others = found.clone();
        let before = others.remove(i);
        let is_free = |f: &Found<S>| is_latent(sessions, f.effect);
        if others.iter().any(is_free) && !is_free(&before) {
            continue;
        }
        let ranked = beside(data, sessions, &others, candidates);
        let better = chosen(data, sessions, &ranked, &others);
        if let Some(better) = better.filter(|b| b.effect.name() != before.effect.name()) {
            others.push(better);
            refit_newest(sessions, &mut others);
            *found = others;
        }
    }
}

/// Fits all of `found` together, the last where its evidence says that it acts.
fn refit_newest<S: Observed>(sessions: &[S], found: &mut [Found<S>]) {
    let streams = found.last().map(|f| f.streams.clone());
    refit(sessions, found, streams.as_deref());
}

/// Whether a candidate explains a part of some residual that is worth a name beside `found`.
fn is_material<S: Observed>(
    data: &Data,
    sessions: &[S],
    candidate: &Ranked<S>,
    found: &[Found<S>],
) -> bool {
    let trial = &candidate.trial;
    let times = if found.is_empty() { SURE } else { SURE_BESIDE };
    let sure = (candidate.threshold).is_some_and(|threshold| trial.score > times * threshold);
    let least = if is_latent(sessions, candidate.effect) {
        MATERIAL_OF_LATENT
    } else if sure && sessions.iter().all(Observed::is_referred) {
        MATERIAL_OF_SURE
    } else {
        MATERIAL
    };
    let gains = trial.streams.iter().zip(&trial.overdispersion);
    gains
        .enumerate()
        .any(|(k, (gain, over))| data.squares(k, gain / over) > least * data.independent(k))
}

/// Whether a signal of the effect is free to explain anything.
pub(super) fn is_latent<S: Observed>(sessions: &[S], effect: &dyn Effect<S>) -> bool {
    sessions.iter().any(|s| effect.latent(s) > 0.0)
}

/// The first of `ranked`, or what explains the same with fewer parameters (a gauge that came
/// loose before the recording began has another gain), of such the first in the library.
fn simplest<'a, S: Observed>(
    data: &Data,
    sessions: &[S],
    ranked: &'a [Ranked<S>],
    found: &[Found<S>],
) -> Option<&'a Ranked<S>> {
    let best = ranked.first()?;
    let place = |r: &Ranked<S>| {
        let named = |e: &&dyn Effect<S>| e.name() == r.effect.name();
        S::library().iter().position(named)
    };
    ranked
        .iter()
        .filter(|r| says_the_same(data, sessions, best, r, found))
        .min_by_key(|r| (r.effect.numbers(), place(r)))
}

/// Whether `other` explains what `best` does, but for chance or, with fewer parameters, for
/// what a form that is not quite right leaves: its own, or those `found` before. A signal that is
/// free to explain anything has to explain more than the form of `best` may leave.
fn says_the_same<S: Observed>(
    data: &Data,
    sessions: &[S],
    best: &Ranked<S>,
    other: &Ranked<S>,
    found: &[Found<S>],
) -> bool {
    let gap = best.trial.score - other.trial.score;
    let explained = |r: &Ranked<S>| -> f64 {
        let gains = r.trial.streams.iter().enumerate();
        gains.map(|(k, gain)| data.squares(k, *gain)).sum()
    };
    let part = if found.is_empty() { SAME } else { SAME_BESIDE };
    let is_free = |r: &Ranked<S>| is_latent(sessions, r.effect);
    if is_free(other) && !is_free(best) && !exceeds(data, &sessions[0], best, other) {
        return false;
    }
    match (other.effect.numbers()).cmp(&best.effect.numbers()) {
        Ordering::Less if is_silent(data, best, other) => false,
        Ordering::Less => gap < FURTHER || explained(best) < (1.0 + part) * explained(other),
        Ordering::Equal => gap < same(best.trial.score),
        Ordering::Greater => false,
    }
}

/// Whether the free signal of `other` explains more beyond `best`, in squares over those of a clean
/// machine, than twice what the form of `best` may be off by.
fn exceeds<S: Observed>(data: &Data, session: &S, best: &Ranked<S>, other: &Ranked<S>) -> bool {
    let (mut beyond, mut explained) = (0.0, 0.0);
    for (k, excess) in best.trial.excess.iter().enumerate() {
        let left = |r: &Ranked<S>| {
            let explained = data.squares(k, r.trial.streams[k].max(0.0)) / data.independent(k);
            left(*excess, explained)
        };
        beyond += left(best) - left(other);
        explained += excess - left(best);
    }
    beyond > 2.0 * best.effect.form(session).powi(2) * explained
}

/// Whether `other` explains nothing of a residual of which `best` explains more than it leaves.
fn is_silent<S: Observed>(data: &Data, best: &Ranked<S>, other: &Ranked<S>) -> bool {
    let gains = best.trial.streams.iter().zip(&other.trial.streams);
    gains.enumerate().any(|(k, (of_best, of_other))| {
        *of_other <= 0.0 && *of_best > LEAST && data.squares(k, *of_best) > data.independent(k)
    })
}

/// Whether all that tells the two apart did not happen in the recordings: friction that builds
/// up over an angle, where nothing ever stood still.
fn predicts_the_same<S: Observed>(best: &Ranked<S>, other: &Ranked<S>) -> bool {
    const NOTHING: f64 = 0.05;
    other.effect.lasts() && (best.trial.score - other.trial.score).abs() < NOTHING
}

/// Whether what tells `other` from `best` could be chance.
fn indistinct<S: Observed>(best: &Ranked<S>, other: &Ranked<S>) -> bool {
    let (Some(best), Some(other)) = (best.margin(), other.margin()) else {
        return false;
    };
    other > 0.0 && best - other < same(best)
}

/// Takes out effects without which the evidence is hardly less; the others take
/// the shape that is best beside the rest.
fn settle<S: Observed>(data: &Data, sessions: &[S], found: &mut Vec<Found<S>>) {
    let mut i = 0;
    while found.len() > 1 && i < found.len() {
        let (base, trial) = beside_others(data, sessions, found, i);
        let f = &mut found[i];
        if f.threshold.is_none_or(|threshold| trial.score < threshold) {
            found.remove(i);
        } else {
            f.shape = best_shape(data, &base, sessions, f.effect, trial);
            i += 1;
        }
    }
}

/// Takes out effects that leave most of the excess that they act on beside the others; of several
/// first that of which the evidence beside the others is least.
fn drop_mimics<S: Observed>(data: &Data, sessions: &[S], found: &mut Vec<Found<S>>) {
    while found.len() > 1 {
        let trials = (0..found.len()).map(|i| beside_others(data, sessions, found, i).1);
        let mimics = (trials.enumerate()).filter(|(_, trial)| cleared(data, trial) < OF_EXCESS);
        let least = mimics.min_by(|a, b| a.1.score.total_cmp(&b.1.score));
        let Some((i, _)) = least else { break };
        found.remove(i);
        refit(sessions, found, None);
    }
}

/// What is in the model with all of `found` but that at `i`, and how well that does beside it.
fn beside_others<S: Observed>(
    data: &Data,
    sessions: &[S],
    found: &[Found<S>],
    i: usize,
) -> (Base, Trial) {
    let mut all = columns_of(sessions, found);
    let columns = all.remove(i);
    let mut others = found.to_vec();
    let f = others.remove(i);
    let base = data.base(with_effects(nuisances(sessions, &others), &others, all));
    let mut trial = data.trial(
        &data.with_nuisances(&base, sessions, f.effect, &f.shape),
        f.effect,
        &f.shape,
        &columns,
        Some(&f.overdispersion),
    );
    charge(f.effect, sessions, &mut trial);
    (base, trial)
}
