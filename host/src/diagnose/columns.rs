//! What is in the model, and what an effect would add, as columns.

use super::effect::Effect;
use super::fit::Prior;
use super::observed::Observed;
use super::select::Found;
use super::stream::Columns;

pub(super) fn joined<S>(sessions: &[S], of: impl Fn(&S) -> Vec<f64>) -> Vec<f64> {
    sessions.iter().flat_map(of).collect()
}

/// Nuisances of each stream, after them those that go with each effect found.
pub(super) fn nuisances<S: Observed>(sessions: &[S], found: &[Found<S>]) -> Vec<Vec<Prior>> {
    let mut nuisances: Vec<Vec<Prior>> = (0..sessions[0].streams().len())
        .map(|k| {
            let per_session: Vec<Vec<Prior>> = sessions.iter().map(|s| s.nuisances(k)).collect();
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
    (0..sessions[0].streams().len())
        .map(|k| {
            (0..per_session[0].len())
                .map(|j| per_session.iter().flat_map(|s| s[j][k].clone()).collect())
                .filter(|column: &Vec<f64>| !column.is_empty())
                .map(|column| Prior { column, std: 1.0 })
                .collect()
        })
        .collect()
}

/// Nuisances, and each effect found with parameters free in each stream.
pub(super) fn base_columns<S: Observed>(sessions: &[S], found: &[Found<S>]) -> Vec<Vec<Prior>> {
    let mut base = nuisances(sessions, found);
    for f in found {
        let columns = columns(sessions, f.effect, &f.shape, &f.parameters);
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
                .map(|k| per_session.iter().flat_map(|s| s[j][k].clone()).collect())
                .collect()
        })
        .collect()
}
