//! Which effects: one after another, the best that is significant, then
//! without those that became superfluous.

use rayon::prelude::*;

use super::effect::{Coupling, Effect, LIBRARY};
use super::fit::{Base, Data, Prior, Trial};
use super::null::Draws;
use super::stream::{Columns, Kind, Session};

/// Chance of an effect being named where there is none, over all candidates.
const FALSE_ALARM: f64 = 0.005;

/// Evidence below which nothing is named, whatever the draws say.
const LEAST: f64 = 8.0;

/// Part of the evidence before it that a further effect must bring: what a
/// form that is not quite right leaves behind is less.
const FURTHER: f64 = 0.05;

/// Most effects that are named.
const MOST: usize = 3;

/// Candidates whose shape is refined.
const REFINED: usize = 6;

/// An effect with its parameters.
#[derive(Clone)]
pub struct Found {
    /// The effect.
    pub effect: &'static dyn Effect,
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
}

/// A candidate with its evidence.
#[derive(Clone)]
pub struct Ranked {
    /// The effect.
    pub effect: &'static dyn Effect,
    /// Its best trial.
    pub trial: Trial,
    /// Evidence that chance alone does not reach.
    pub threshold: f64,
}

impl Ranked {
    /// Evidence beyond what the machine without effect shows.
    pub fn margin(&self) -> f64 {
        self.trial.score - self.threshold
    }
}

/// What the search came to.
pub struct Selection {
    /// Effects, the first found first.
    pub found: Vec<Found>,
    /// All candidates for the first effect, the best first.
    pub ranking: Vec<Ranked>,
    /// Candidates that the data cannot tell from the first one.
    pub alike: Vec<Ranked>,
    /// Nuisance parameters of each stream (zero first).
    pub nuisance: Vec<Vec<f64>>,
    /// Residuals after everything found: `[session][stream]`.
    pub rest: Vec<Vec<Vec<f64>>>,
}

/// Searches the library for what explains the residuals of `sessions`.
pub fn select(sessions: &[Session], draws: &Draws, mut progress: impl FnMut(f64)) -> Selection {
    let mut data = Data::new(sessions, draws);
    let mut found: Vec<Found> = Vec::new();
    let mut ranking = Vec::new();
    let mut alike = Vec::new();
    let mut working = sessions.to_vec();
    for round in 0..MOST {
        let base = data.base(base_columns(sessions, &found));
        let mut ranked = rank(&data, &base, &working, &found);
        progress((round as f64 + 0.7) / MOST as f64);
        refine(&data, &base, &working, &mut ranked);
        let accepted = ranked
            .iter()
            .find(|r| r.margin() > 0.0 && brings_more(r, &found))
            .cloned();
        if round == 0 {
            ranking.clone_from(&ranked);
        }
        let Some(best) = accepted else { break };
        if round == 0 {
            alike = ranked[1..]
                .iter()
                .filter(|other| indistinct(&best, other))
                .cloned()
                .collect();
        }
        found.push(Found {
            effect: best.effect,
            shape: best.trial.shape.clone(),
            parameters: Vec::new(),
            evidence: best.trial.score,
            threshold: best.threshold,
            streams: best.trial.streams.clone(),
        });
        let nuisance = refit(sessions, &mut found, Some(&best.trial.streams));
        for (session, rest) in working.iter_mut().zip(rest(sessions, &found, &nuisance)) {
            for (stream, rest) in session.streams.iter_mut().zip(rest) {
                stream.residual = rest;
            }
        }
        if found.len() > 1 {
            drop_superfluous(&data, sessions, &mut found);
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

/// Whether a candidate brings more, in the streams that it explains, than a
/// form that is not quite right leaves of the effects found before.
fn brings_more(candidate: &Ranked, found: &[Found]) -> bool {
    let (mut brought, mut before) = (0.0, 0.0);
    for (k, gain) in candidate.trial.streams.iter().enumerate() {
        if *gain > 0.02 * candidate.trial.score {
            brought += gain;
            before += found.iter().map(|f| f.streams[k].max(0.0)).sum::<f64>();
        }
    }
    brought > FURTHER * before
}

/// Whether what tells `other` from `best` could be chance.
fn indistinct(best: &Ranked, other: &Ranked) -> bool {
    let gap = best.margin() - other.margin();
    other.margin() > 0.0 && gap < 4.0_f64.max(0.002 * best.margin())
}

/// Columns that are in the model anyway: a zero for each strain and angle,
/// the reference's zero and an error of the inertia in the balance, an error
/// of the stiffness in an angle.
fn nuisances(session: &Session, k: usize) -> Vec<Prior> {
    let stream = &session.streams[k];
    let n = session.signals.len();
    let constant = |part: f64| Prior {
        column: vec![1.0; n],
        std: part * stream.scale,
    };
    match stream.kind {
        Kind::Strain => vec![constant(1.0)],
        Kind::Balance => {
            let moment: f64 = session
                .signals
                .response
                .as_ref()
                .map_or(0.0, |r| r.bodies.iter().map(|b| b.0).sum());
            vec![
                constant(1e-3),
                Prior {
                    column: session
                        .signals
                        .acceleration
                        .iter()
                        .map(|a| a * moment)
                        .collect(),
                    std: 0.02,
                },
            ]
        }
        Kind::Angle => vec![
            constant(1e3),
            Prior {
                column: session
                    .signals
                    .level
                    .iter()
                    .map(|l| l * stream.scale)
                    .collect(),
                std: 0.1,
            },
        ],
    }
}

fn joined(sessions: &[Session], of: impl Fn(&Session) -> Vec<f64>) -> Vec<f64> {
    sessions.iter().flat_map(of).collect()
}

/// Nuisances, and each effect found with parameters free in each stream.
fn base_columns(sessions: &[Session], found: &[Found]) -> Vec<Vec<Prior>> {
    let mut base: Vec<Vec<Prior>> = (0..sessions[0].streams.len())
        .map(|k| {
            let per_session: Vec<Vec<Prior>> = sessions.iter().map(|s| nuisances(s, k)).collect();
            (0..per_session[0].len())
                .map(|j| Prior {
                    column: per_session
                        .iter()
                        .flat_map(|p| p[j].column.clone())
                        .collect(),
                    std: per_session[0][j].std,
                })
                .collect()
        })
        .collect();
    for f in found {
        let columns = columns(sessions, f.effect, &f.shape);
        for (linear, columns) in f.effect.linear().iter().zip(columns) {
            for (k, column) in columns.into_iter().enumerate() {
                if !column.is_empty() {
                    base[k].push(Prior {
                        column,
                        std: linear.prior_std,
                    });
                }
            }
        }
    }
    base
}

/// Columns of an effect over all sessions: `[parameter][stream]`.
fn columns(sessions: &[Session], effect: &dyn Effect, shape: &[f64]) -> Vec<Columns> {
    let per_session: Vec<Vec<Columns>> = sessions
        .iter()
        .map(|session| {
            effect
                .terms(session, shape)
                .iter()
                .map(|term| {
                    let mut columns = session.columns(term);
                    for (stream, column) in session.streams.iter().zip(&mut columns) {
                        if !effect.acts_on(stream) {
                            column.clear();
                        }
                    }
                    columns
                })
                .collect()
        })
        .collect();
    (0..effect.linear().len())
        .map(|j| {
            (0..sessions[0].streams.len())
                .map(|k| per_session.iter().flat_map(|s| s[j][k].clone()).collect())
                .collect()
        })
        .collect()
}

/// All effects on the grid of their shapes, the best evidence first.
fn rank(data: &Data, base: &Base, sessions: &[Session], found: &[Found]) -> Vec<Ranked> {
    let jobs: Vec<(usize, Vec<f64>)> = LIBRARY
        .iter()
        .enumerate()
        .filter(|(_, e)| !found.iter().any(|f| f.effect.name() == e.name()))
        .flat_map(|(i, effect)| {
            effect
                .grid(&sessions[0])
                .into_iter()
                .map(move |shape| (i, shape))
        })
        .collect();
    let trials: Vec<(usize, Trial)> = jobs
        .par_iter()
        .map(|(i, shape)| {
            let effect = LIBRARY[*i];
            let columns = columns(sessions, effect, shape);
            let mut trial = data.trial(base, effect, shape, &columns, true);
            trial.score = charged(effect, sessions, trial.score);
            (*i, trial)
        })
        .collect();
    let mut ranked: Vec<Ranked> = Vec::new();
    let candidates = LIBRARY.len() as f64;
    for (i, effect) in LIBRARY.iter().enumerate() {
        let own: Vec<&Trial> = trials
            .iter()
            .filter(|(j, _)| *j == i)
            .map(|(_, t)| t)
            .collect();
        let Some(best) = own.iter().max_by(|a, b| a.score.total_cmp(&b.score)) else {
            continue;
        };
        let draws = best.null.len();
        let largest: Vec<f64> = (0..draws)
            .map(|m| own.iter().map(|t| t.null[m]).fold(0.0, f64::max))
            .collect();
        ranked.push(Ranked {
            effect: *effect,
            trial: (*best).clone(),
            threshold: by_chance(&largest, FALSE_ALARM / candidates),
        });
    }
    ranked.sort_by(|a, b| b.margin().total_cmp(&a.margin()));
    ranked
}

/// Evidence that a machine without the effect hardly reaches.
///
/// What the draws have in common is how the machine itself differs from its
/// model; the simulations know that only roughly, because they do what the
/// recording did only roughly.
fn by_chance(draws: &[f64], probability: f64) -> f64 {
    const ROUGHLY: f64 = 0.5;
    let mean = draws.iter().sum::<f64>() / draws.len().max(1) as f64;
    (gumbel(draws, probability) + ROUGHLY * mean).max(LEAST)
}

/// Evidence less what latent degrees of freedom cost.
fn charged(effect: &dyn Effect, sessions: &[Session], score: f64) -> f64 {
    let latent: f64 = sessions.iter().map(|s| effect.latent(s)).sum();
    if latent == 0.0 {
        return score;
    }
    let samples: f64 = sessions.iter().map(|s| s.signals.len() as f64).sum();
    0.9 * (score - 0.5 * latent * samples.ln())
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

/// Refines the shapes of the best candidates by a pattern search.
fn refine(data: &Data, base: &Base, sessions: &[Session], ranked: &mut [Ranked]) {
    const ROUNDS: usize = 5;
    let best = ranked.first().map_or(0.0, Ranked::margin);
    ranked
        .par_iter_mut()
        .take(REFINED)
        .filter(|r| r.margin() > 0.3 * best && r.trial.score > 0.5 * r.threshold)
        .for_each(|candidate| {
            let effect = candidate.effect;
            let evaluate = |shape: &[f64]| {
                let columns = columns(sessions, effect, shape);
                let mut trial = data.trial(base, effect, shape, &columns, false);
                trial.score = charged(effect, sessions, trial.score);
                trial
            };
            for (j, parameter) in effect.shape().iter().enumerate() {
                let mut step = parameter.step;
                if step == 0.0 {
                    continue;
                }
                let mut rounds = 0;
                while rounds < ROUNDS {
                    let mut moved = false;
                    for sign in [1.0, -1.0] {
                        let mut shape = candidate.trial.shape.clone();
                        shape[j] = if parameter.logarithmic {
                            shape[j] * (sign * step).exp()
                        } else {
                            shape[j] + sign * step
                        }
                        .clamp(parameter.bounds.0, parameter.bounds.1);
                        let trial = evaluate(&shape);
                        if trial.score > candidate.trial.score {
                            candidate.trial = trial;
                            moved = true;
                            break;
                        }
                    }
                    if !moved {
                        step *= 0.4;
                        rounds += 1;
                    }
                }
            }
        });
    ranked.sort_by(|a, b| b.margin().total_cmp(&a.margin()));
}

/// Takes out effects without which the evidence is hardly less.
fn drop_superfluous(data: &Data, sessions: &[Session], found: &mut Vec<Found>) {
    let mut i = 0;
    while found.len() > 1 && i < found.len() {
        let others: Vec<Found> = found
            .iter()
            .enumerate()
            .filter(|(j, _)| *j != i)
            .map(|(_, f)| f.clone())
            .collect();
        let base = data.base(base_columns(sessions, &others));
        let f = &mut found[i];
        let columns = columns(sessions, f.effect, &f.shape);
        let trial = data.trial(&base, f.effect, &f.shape, &columns, false);
        if trial.score < f.threshold {
            found.remove(i);
        } else {
            i += 1;
        }
    }
}

/// Evidence that a stream must give for an effect with parameters of its own
/// to be taken to act on it.
const ACTS: f64 = 4.0;

/// Fits all parameters together: nuisances of each stream and effects in
/// turn, until they agree.
#[allow(
    clippy::too_many_lines,
    reason = "the two halves of a step share all that they change"
)]
fn refit(sessions: &[Session], found: &mut [Found], newest: Option<&[f64]>) -> Vec<Vec<f64>> {
    const ROUNDS: usize = 25;
    let streams = sessions[0].streams.len();
    let base = base_columns(sessions, &[]);
    let residuals: Vec<Vec<f64>> = (0..streams)
        .map(|k| joined(sessions, |s| s.streams[k].residual.clone()))
        .collect();
    let all: Vec<Vec<Columns>> = found
        .iter()
        .map(|f| columns(sessions, f.effect, &f.shape))
        .collect();
    let mut nuisance: Vec<Vec<f64>> = base.iter().map(|b| vec![0.0; b.len()]).collect();
    if let (Some(gains), Some(last)) = (newest, found.last_mut()) {
        // Which streams the newest one acts on.
        let least = ACTS.max(0.005 * gains.iter().copied().fold(0.0, f64::max));
        last.parameters = (0..streams)
            .map(|k| {
                let acts = last.effect.coupling() == Coupling::Shared || gains[k] > least;
                vec![0.0; if acts { last.effect.linear().len() } else { 0 }]
            })
            .collect();
    }
    let mut rest = residuals.clone();
    let weight: Vec<f64> = sessions[0]
        .streams
        .iter()
        .map(|s| 1.0 / (s.noise_std * s.noise_std))
        .collect();
    let subtract = |rest: &mut [f64], column: &[f64], by: f64| {
        for (r, c) in rest.iter_mut().zip(column) {
            *r -= by * c;
        }
    };
    for f in found.iter_mut() {
        for parameters in &mut f.parameters {
            parameters.fill(0.0);
        }
    }
    for _ in 0..ROUNDS {
        for k in 0..streams {
            // Nuisances and the stream's own parameters together.
            let mut own: Vec<(&[f64], f64)> = base[k]
                .iter()
                .map(|p| (p.column.as_slice(), p.std))
                .collect();
            for (f, columns) in found.iter().zip(&all) {
                if f.effect.coupling() == Coupling::Own && !f.parameters[k].is_empty() {
                    for (linear, c) in f.effect.linear().iter().zip(columns) {
                        if !c[k].is_empty() {
                            own.push((&c[k], linear.prior_std));
                        }
                    }
                }
            }
            let step = least_squares(
                &own,
                &rest[k],
                weight[k],
                &current(&nuisance[k], found, &all, k),
            );
            for ((column, _), by) in own.iter().zip(&step) {
                subtract(&mut rest[k], column, *by);
            }
            let mut steps = step.into_iter();
            for value in &mut nuisance[k] {
                *value += steps.next().unwrap_or(0.0);
            }
            for (f, columns) in found.iter_mut().zip(&all) {
                if f.effect.coupling() == Coupling::Own && !columns[0][k].is_empty() {
                    for value in &mut f.parameters[k] {
                        *value += steps.next().unwrap_or(0.0);
                    }
                }
            }
        }
        for (f, columns) in found.iter_mut().zip(&all) {
            if f.effect.coupling() == Coupling::Shared {
                shared_step(f, columns, &mut rest, &weight);
            }
        }
    }
    nuisance
}

/// Parameters of stream `k` as they stand, in the order of its columns.
fn current(nuisance: &[f64], found: &[Found], all: &[Vec<Columns>], k: usize) -> Vec<f64> {
    let own = found
        .iter()
        .zip(all)
        .filter(|(f, c)| f.effect.coupling() == Coupling::Own && !c[0][k].is_empty())
        .flat_map(|(f, _)| f.parameters[k].iter().copied());
    nuisance.iter().copied().chain(own).collect()
}

/// Step towards the minimum of `weight |rest - columns step|^2 + |(now + step)/std|^2`.
fn least_squares(columns: &[(&[f64], f64)], rest: &[f64], weight: f64, now: &[f64]) -> Vec<f64> {
    let p = columns.len();
    let mut gram = faer::Mat::<f64>::zeros(p, p);
    let mut right = faer::Mat::<f64>::zeros(p, 1);
    for (i, r) in rest.iter().enumerate().filter(|(_, r)| r.is_finite()) {
        for (a, (x, _)) in columns.iter().enumerate() {
            right[(a, 0)] += weight * x[i] * r;
            for (b, (y, _)) in columns[..=a].iter().enumerate() {
                gram[(a, b)] += weight * x[i] * y[i];
            }
        }
    }
    super::fit::mirror(&mut gram);
    let ridge: Vec<f64> = columns.iter().map(|(_, std)| 1.0 / (std * std)).collect();
    for (a, ridge) in ridge.iter().enumerate() {
        right[(a, 0)] -= ridge * now.get(a).copied().unwrap_or(0.0);
    }
    let step = super::fit::solved(gram, &right, &ridge);
    (0..p).map(|a| step[(a, 0)]).collect()
}

fn shared_step(f: &mut Found, columns: &[Columns], rest: &mut [Vec<f64>], weight: &[f64]) {
    let c = columns.len();
    let mut gram = faer::Mat::<f64>::zeros(c, c);
    let mut right = faer::Mat::<f64>::zeros(c, 1);
    for (k, rest) in rest.iter().enumerate() {
        if columns.iter().any(|x| x[k].is_empty()) {
            continue;
        }
        for (i, r) in rest.iter().enumerate().filter(|(_, r)| r.is_finite()) {
            for a in 0..c {
                right[(a, 0)] += weight[k] * columns[a][k][i] * r;
                for b in 0..=a {
                    gram[(a, b)] += weight[k] * columns[a][k][i] * columns[b][k][i];
                }
            }
        }
    }
    super::fit::mirror(&mut gram);
    let step = super::fit::solved(gram, &right, &vec![0.0; c]);
    for (k, rest) in rest.iter_mut().enumerate() {
        if columns.iter().any(|x| x[k].is_empty()) {
            f.parameters[k].clear();
            continue;
        }
        for a in 0..c {
            f.parameters[k][a] += step[(a, 0)];
            for (r, x) in rest.iter_mut().zip(&columns[a][k]) {
                *r -= step[(a, 0)] * x;
            }
        }
    }
}

/// Residuals of `sessions` less nuisances and effects: `[session][stream]`.
pub fn rest(sessions: &[Session], found: &[Found], nuisance: &[Vec<f64>]) -> Vec<Vec<Vec<f64>>> {
    sessions
        .iter()
        .map(|session| {
            let one = std::slice::from_ref(session);
            let base = base_columns(one, &[]);
            let all: Vec<Vec<Columns>> = found
                .iter()
                .map(|f| columns(one, f.effect, &f.shape))
                .collect();
            (0..session.streams.len())
                .map(|k| {
                    let mut rest = session.streams[k].residual.clone();
                    let mut subtract = |column: &[f64], by: f64| {
                        for (r, c) in rest.iter_mut().zip(column) {
                            *r -= by * c;
                        }
                    };
                    for (prior, value) in base[k].iter().zip(&nuisance[k]) {
                        subtract(&prior.column, *value);
                    }
                    for (f, columns) in found.iter().zip(&all) {
                        for (column, value) in columns.iter().zip(&f.parameters[k]) {
                            subtract(&column[k], *value);
                        }
                    }
                    rest
                })
                .collect()
        })
        .collect()
}
