//! What is in the model, and what an effect would add, as columns.

use std::mem::take;

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
            let mut per_session: Vec<Vec<Nuisance>> =
                sessions.iter().map(|s| s.nuisances(k)).collect();
            let joined = (0..per_session[0].len()).map(|j| Nuisance {
                column: in_stream(sessions, |s| take(&mut per_session[s][j].column)),
                ..per_session[0][j]
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
    let mut per_session: Vec<Vec<Columns>> = (sessions.iter())
        .map(|session| session.nuisances_of(effect, shape))
        .collect();
    let count = per_session[0].len();
    let of_stream = |k: usize| {
        let own = |j: usize| in_stream(sessions, |s| take(&mut per_session[s][j][k]));
        let columns = (0..count).map(own);
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

/// A column of one stream over all sessions, from its `part` in each; empty where it is in each.
fn in_stream<S: Observed>(sessions: &[S], part: impl FnMut(usize) -> Vec<f64>) -> Vec<f64> {
    let parts: Vec<Vec<f64>> = (0..sessions.len()).map(part).collect();
    if parts.iter().all(Vec::is_empty) {
        return Vec::new();
    }
    let mut column = Vec::new();
    let mut end = 0;
    for (session, part) in sessions.iter().zip(parts) {
        end += session.speed().len();
        if column.is_empty() {
            column = part;
        } else {
            column.extend(part);
        }
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
    let mut all: Vec<Vec<Columns>> = found.iter().map(|f| of(sessions, f)).collect();
    let (latent, told): (Vec<usize>, Vec<usize>) =
        (0..found.len()).partition(|i| is_latent(sessions, found[*i].effect));
    if latent.is_empty() || told.is_empty() {
        return all;
    }
    let effects = told.iter().map(|i| (&found[*i], all[*i].as_slice()));
    let left = less(sessions, &[], &[], &effects.collect::<Vec<_>>());
    let left = leaving(sessions, left);
    for i in latent {
        all[i] = of(&left, &found[i]);
    }
    all
}

/// Residuals of `sessions` less `base` times `nuisance` and less effects by their columns:
/// `[session][stream]`.
pub(super) fn less<S: Observed>(
    sessions: &[S],
    base: &[Vec<Prior>],
    nuisance: &[Vec<f64>],
    effects: &[(&Found<S>, &[Columns])],
) -> Vec<Vec<Vec<f64>>> {
    let mut rests = vec![Vec::new(); sessions.len()];
    for k in 0..sessions[0].streams().len() {
        let mut rest = joined(sessions, |s| s.residual(k).to_vec());
        let mut subtract = |column: &[f64], by: f64| {
            for (r, c) in rest.iter_mut().zip(column) {
                *r -= by * c;
            }
        };
        if let (Some(priors), Some(values)) = (base.get(k), nuisance.get(k)) {
            for (prior, value) in priors.iter().zip(values) {
                subtract(&prior.column, *value);
            }
        }
        for (f, columns) in effects {
            for (column, value) in columns.iter().zip(&f.parameters[k]) {
                subtract(&column[k], *value);
            }
        }
        let mut rest = rest.as_slice();
        for (session, rests) in sessions.iter().zip(&mut rests) {
            let (own, others) = rest.split_at(session.residual(k).len());
            rests.push(own.to_vec());
            rest = others;
        }
    }
    rests
}

/// `sessions` with `rests` (`[session][stream]`) as their residuals.
pub(super) fn leaving<S: Observed>(sessions: &[S], rests: Vec<Vec<Vec<f64>>>) -> Vec<S> {
    let mut left = sessions.to_vec();
    for (session, rest) in left.iter_mut().zip(rests) {
        for (k, rest) in rest.into_iter().enumerate() {
            session.set_residual(k, rest);
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
    let mut per_session: Vec<Vec<Columns>> = sessions
        .iter()
        .map(|session| session.columns(effect, shape, parameters))
        .collect();
    (0..effect.linear().len())
        .map(|j| {
            (0..sessions[0].streams().len())
                .map(|k| in_stream(sessions, |s| take(&mut per_session[s][j][k])))
                .collect()
        })
        .collect()
}
