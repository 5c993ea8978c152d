//! What is in the model, and what an effect would add, as columns.

use super::effect::Effect;
use super::fit::Prior;
use super::observed::{Nuisance, Observed};
use super::select::{Found, is_latent};
use super::stream::Columns;

pub(super) fn joined<S>(sessions: &[S], of: impl Fn(&S) -> Vec<f64>) -> Vec<f64> {
    sessions.iter().flat_map(of).collect()
}

/// Nuisances of each stream, after them those that go with each effect found.
pub(super) fn nuisances<S: Observed>(sessions: &[S], found: &[Found<S>]) -> Vec<Vec<Prior>> {
    let mut nuisances: Vec<Vec<Prior>> = (0..sessions[0].streams().len())
        .map(|k| {
            let per_session: Vec<Vec<Nuisance>> = sessions.iter().map(|s| s.nuisances(k)).collect();
            let joined = per_session[0]
                .iter()
                .enumerate()
                .map(|(j, first)| Nuisance {
                    column: in_stream(sessions, |s| &per_session[s][j].column),
                    ..*first
                });
            over_all(sessions, joined)
        })
        .collect();
    for f in found {
        let of_effect = nuisances_of(sessions, f.effect, &f.shape);
        for (own, of_effect) in nuisances.iter_mut().zip(of_effect) {
            own.extend(of_effect);
        }
    }
    nuisances
}

/// Nuisances of each stream that go with `effect`.
pub(super) fn nuisances_of<S: Observed>(
    sessions: &[S],
    effect: &dyn Effect<S>,
    shape: &[f64],
) -> Vec<Vec<Prior>> {
    let per_session: Vec<Vec<Columns>> = (sessions.iter())
        .map(|session| session.nuisances_of(effect, shape))
        .collect();
    let of_stream = |k: usize| {
        let own = |j: usize| in_stream(sessions, |s| &per_session[s][j][k]);
        let columns = (0..per_session[0].len()).map(own);
        let acting = columns.filter(|column| !column.is_empty());
        over_all(
            sessions,
            acting.map(|c| Nuisance::of_recording(c, 1.0, 1.0)),
        )
    };
    (0..sessions[0].streams().len()).map(of_stream).collect()
}

/// Nuisances of one stream over all sessions: what these have in common, and, where there are
/// several, how each differs from that.
fn over_all<S: Observed>(sessions: &[S], joined: impl Iterator<Item = Nuisance>) -> Vec<Prior> {
    let (mut common, mut differing) = (Vec::new(), Vec::new());
    for Nuisance {
        column,
        std,
        spread,
    } in joined
    {
        let differs = sessions.len() > 1 && spread > 0.0;
        let mut from = 0;
        for session in sessions.iter().filter(|_| differs) {
            let own = from..from + session.speed().len();
            let mut alone = vec![0.0; column.len()];
            alone[own.clone()].copy_from_slice(&column[own.clone()]);
            differing.push(Prior {
                column: alone,
                std: spread,
            });
            from = own.end;
        }
        common.push(Prior { column, std });
    }
    common.extend(differing);
    common
}

/// A column of one stream over all sessions, of which it is `part`; empty where it is in each.
fn in_stream<'a, S: Observed>(sessions: &[S], part: impl Fn(usize) -> &'a Vec<f64>) -> Vec<f64> {
    if (0..sessions.len()).all(|s| part(s).is_empty()) {
        return Vec::new();
    }
    let mut column = Vec::new();
    let mut end = 0;
    for (s, session) in sessions.iter().enumerate() {
        end += session.speed().len();
        column.extend(part(s));
        column.resize(end, 0.0);
    }
    column
}

/// Nuisances, and each effect found with parameters free in each stream.
pub(super) fn base_columns<S: Observed>(sessions: &[S], found: &[Found<S>]) -> Vec<Vec<Prior>> {
    with_effects(
        nuisances(sessions, found),
        found,
        columns_of(sessions, found),
    )
}

/// `base`, and the `columns` of each effect found with parameters free in each stream.
pub(super) fn with_effects<S: Observed>(
    mut base: Vec<Vec<Prior>>,
    found: &[Found<S>],
    columns: Vec<Vec<Columns>>,
) -> Vec<Vec<Prior>> {
    for (f, columns) in found.iter().zip(columns) {
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

/// Columns of each effect found: `[effect][parameter][stream]`. A signal that is free is that of
/// what the other effects leave: told from all, it would be theirs as well.
pub(super) fn columns_of<S: Observed>(sessions: &[S], found: &[Found<S>]) -> Vec<Vec<Columns>> {
    let of = |sessions: &[S], f: &Found<S>| columns(sessions, f.effect, &f.shape, &f.parameters);
    let all: Vec<Vec<Columns>> = found.iter().map(|f| of(sessions, f)).collect();
    let (latent, told): (Vec<usize>, Vec<usize>) =
        (0..found.len()).partition(|i| is_latent(sessions, found[*i].effect));
    if latent.is_empty() || told.is_empty() {
        return all;
    }
    let told: Vec<(&Found<S>, &[Columns])> = told
        .iter()
        .map(|i| (&found[*i], all[*i].as_slice()))
        .collect();
    let left = less(sessions, &told);
    let mut all = all;
    for i in latent {
        all[i] = of(&left, &found[i]);
    }
    all
}

/// `sessions` without what those found predict by their columns.
fn less<S: Observed>(sessions: &[S], found: &[(&Found<S>, &[Columns])]) -> Vec<S> {
    let mut left = sessions.to_vec();
    for k in 0..sessions[0].streams().len() {
        let mut from = 0;
        for session in &mut left {
            let mut residual = session.residual(k).to_vec();
            for (f, columns) in found {
                for (column, value) in columns.iter().zip(&f.parameters[k]) {
                    for (r, c) in residual.iter_mut().zip(column[k].iter().skip(from)) {
                        *r -= value * c;
                    }
                }
            }
            from += residual.len();
            session.set_residual(k, residual);
        }
    }
    left
}

/// Columns of an effect over all sessions, taken as linear about `parameters`
/// (`[stream]`): `[parameter][stream]`.
pub(super) fn columns<S: Observed>(
    sessions: &[S],
    effect: &dyn Effect<S>,
    shape: &[f64],
    parameters: &[Vec<f64>],
) -> Vec<Columns> {
    let per_session: Vec<Vec<Columns>> = sessions
        .iter()
        .map(|session| session.columns(effect, shape, parameters))
        .collect();
    (0..effect.linear().len())
        .map(|j| {
            (0..sessions[0].streams().len())
                .map(|k| in_stream(sessions, |s| &per_session[s][j][k]))
                .collect()
        })
        .collect()
}
