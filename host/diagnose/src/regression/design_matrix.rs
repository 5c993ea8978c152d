//! Builds the design matrix of all recordings: columns of nuisances and effects for each signal,
//! with the prior standard deviations of their coefficients. Subtracts fitted columns from
//! residuals.

use std::mem::take;

use crate::candidate_effect::Effect;
use crate::candidate_effect::fitted::{FittedEffect, is_free_signal};
use crate::regression::cross_validation::PriorColumn;
use crate::residual_model::Columns;
use crate::residual_model::{Nuisance, ResidualModel};

/// Linearisations of a nonlinear effect about its fitted parameters.
pub(crate) const GAUSS_NEWTON_STEPS: usize = 4;

pub(crate) fn concatenate<S>(recordings: &[S], of: impl Fn(&S) -> Vec<f64>) -> Vec<f64> {
    recordings.iter().flat_map(of).collect()
}

/// Nuisances of each signal, after them those that go with each effect found.
pub(crate) fn nuisances<S: ResidualModel>(
    recordings: &[S],
    found: &[FittedEffect<S>],
) -> Vec<Vec<PriorColumn>> {
    let mut nuisances: Vec<Vec<PriorColumn>> = (0..recordings[0].residuals().len())
        .map(|k| {
            let mut per_session: Vec<Vec<Nuisance>> =
                recordings.iter().map(|s| s.nuisances(k)).collect();
            let concatenate = (0..per_session[0].len()).map(|j| Nuisance {
                column: concatenate_signal(recordings, |s| take(&mut per_session[s][j].column)),
                ..per_session[0][j]
            });
            block_diagonal(recordings, concatenate)
        })
        .collect();
    for f in found {
        let of_effect = nuisances_of(recordings, f.effect, &f.shape);
        for (own, of_effect) in nuisances.iter_mut().zip(of_effect) {
            own.extend(of_effect);
        }
    }
    nuisances
}

/// Nuisances of each signal that go with `effect`.
pub(crate) fn nuisances_of<S: ResidualModel>(
    recordings: &[S],
    effect: &dyn Effect<S>,
    shape: &[f64],
) -> Vec<Vec<PriorColumn>> {
    let mut per_session: Vec<Vec<Columns>> = (recordings.iter())
        .map(|recording| recording.nuisances_of(effect, shape))
        .collect();
    let count = per_session[0].len();
    let of_stream = |k: usize| {
        let own = |j: usize| concatenate_signal(recordings, |s| take(&mut per_session[s][j][k]));
        let columns = (0..count).map(own);
        let acting = columns.filter(|column| !column.is_empty());
        block_diagonal(
            recordings,
            acting.map(|c| Nuisance::per_recording(c, 1.0, 1.0)),
        )
    };
    (0..recordings[0].residuals().len())
        .map(of_stream)
        .collect()
}

/// Nuisances of one signal over all recordings: what these have in common, and, where there are
/// several, how each differs from that.
fn block_diagonal<S: ResidualModel>(
    recordings: &[S],
    concatenate: impl Iterator<Item = Nuisance>,
) -> Vec<PriorColumn> {
    let (mut common_covariates, mut differing) = (Vec::new(), Vec::new());
    for Nuisance {
        column,
        std,
        std_between_recordings,
    } in concatenate
    {
        let differs = recordings.len() > 1 && std_between_recordings > 0.0;
        let mut from = 0;
        for recording in recordings.iter().filter(|_| differs) {
            let own = from..from + recording.speed().len();
            let mut alone = vec![0.0; column.len()];
            alone[own.clone()].copy_from_slice(&column[own.clone()]);
            differing.push(PriorColumn {
                column: alone,
                std: std_between_recordings,
            });
            from = own.end;
        }
        common_covariates.push(PriorColumn { column, std });
    }
    common_covariates.extend(differing);
    common_covariates
}

/// A column of one signal over all recordings, from its `part` in each; empty where it is in each.
fn concatenate_signal<S: ResidualModel>(
    recordings: &[S],
    part: impl FnMut(usize) -> Vec<f64>,
) -> Vec<f64> {
    let parts: Vec<Vec<f64>> = (0..recordings.len()).map(part).collect();
    if parts.iter().all(Vec::is_empty) {
        return Vec::new();
    }
    let mut column = Vec::new();
    let mut end = 0;
    for (recording, part) in recordings.iter().zip(parts) {
        end += recording.speed().len();
        if column.is_empty() {
            column = part;
        } else {
            column.extend(part);
        }
        column.resize(end, 0.0);
    }
    column
}

/// Nuisances, and each effect found with parameters free in each signal.
pub(crate) fn base_columns<S: ResidualModel>(
    recordings: &[S],
    found: &[FittedEffect<S>],
) -> Vec<Vec<PriorColumn>> {
    with_effects(
        nuisances(recordings, found),
        found,
        columns_of(recordings, found),
    )
}

/// `base`, and the `columns` of each effect found with parameters free in each signal.
pub(crate) fn with_effects<S: ResidualModel>(
    mut base: Vec<Vec<PriorColumn>>,
    found: &[FittedEffect<S>],
    columns: Vec<Vec<Columns>>,
) -> Vec<Vec<PriorColumn>> {
    for (f, columns) in found.iter().zip(columns) {
        for (linear, columns) in f.effect.linear_parameters().iter().zip(columns) {
            for (k, column) in columns.into_iter().enumerate() {
                if !column.is_empty() {
                    base[k].push(PriorColumn {
                        column,
                        std: linear.prior_std,
                    });
                }
            }
        }
    }
    base
}

/// Columns of each effect found: `[effect][parameter][signal]`. A free signal is estimated
/// from the residual of the other effects: estimated from the whole, it would contain theirs too.
pub(crate) fn columns_of<S: ResidualModel>(
    recordings: &[S],
    found: &[FittedEffect<S>],
) -> Vec<Vec<Columns>> {
    let of = |recordings: &[S], f: &FittedEffect<S>| {
        columns(recordings, f.effect, &f.shape, &f.parameters)
    };
    let mut all: Vec<Vec<Columns>> = found.iter().map(|f| of(recordings, f)).collect();
    let (free_degrees, parametric): (Vec<usize>, Vec<usize>) =
        (0..found.len()).partition(|i| is_free_signal(recordings, found[*i].effect));
    if free_degrees.is_empty() || parametric.is_empty() {
        return all;
    }
    let effects = parametric.iter().map(|i| (&found[*i], all[*i].as_slice()));
    let left = residual_after(recordings, &[], &[], &effects.collect::<Vec<_>>());
    let left = with_residuals(recordings, left);
    for i in free_degrees {
        all[i] = of(&left, &found[i]);
    }
    all
}

/// Residuals of `recordings` less `base` times `nuisance` and less effects by their columns:
/// `[recording][signal]`.
pub(crate) fn residual_after<S: ResidualModel>(
    recordings: &[S],
    base: &[Vec<PriorColumn>],
    nuisance: &[Vec<f64>],
    effects: &[(&FittedEffect<S>, &[Columns])],
) -> Vec<Vec<Vec<f64>>> {
    let mut rests = vec![Vec::new(); recordings.len()];
    for k in 0..recordings[0].residuals().len() {
        let mut residuals_after = concatenate(recordings, |s| s.residual(k).to_vec());
        let mut subtract = |column: &[f64], by: f64| {
            for (r, c) in residuals_after.iter_mut().zip(column) {
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
        let mut residuals_after = residuals_after.as_slice();
        for (recording, rests) in recordings.iter().zip(&mut rests) {
            let (own, others) = residuals_after.split_at(recording.residual(k).len());
            rests.push(own.to_vec());
            residuals_after = others;
        }
    }
    rests
}

/// `recordings` with `rests` (`[recording][signal]`) as their residuals.
pub(crate) fn with_residuals<S: ResidualModel>(
    recordings: &[S],
    rests: Vec<Vec<Vec<f64>>>,
) -> Vec<S> {
    let mut left = recordings.to_vec();
    for (recording, residuals_after) in left.iter_mut().zip(rests) {
        for (k, residuals_after) in residuals_after.into_iter().enumerate() {
            recording.set_residual(k, residuals_after);
        }
    }
    left
}

/// Columns of an effect over all recordings, linearised about `parameters`
/// (`[signal]`): `[parameter][signal]`.
pub(crate) fn columns<S: ResidualModel>(
    recordings: &[S],
    effect: &dyn Effect<S>,
    shape: &[f64],
    parameters: &[Vec<f64>],
) -> Vec<Columns> {
    let mut per_session: Vec<Vec<Columns>> = recordings
        .iter()
        .map(|recording| recording.columns(effect, shape, parameters))
        .collect();
    (0..effect.linear_parameters().len())
        .map(|j| {
            (0..recordings[0].residuals().len())
                .map(|k| concatenate_signal(recordings, |s| take(&mut per_session[s][j][k])))
                .collect()
        })
        .collect()
}
