//! Fits nuisances and effects in all signals together by least squares, with Gauss-Newton steps
//! where an effect is nonlinear, and computes the residuals after them.

use faer::Mat;

use crate::candidate_effect::Scope;
use crate::candidate_effect::fitted::{FittedEffect, is_free_signal};
use crate::regression::cross_validation::PriorColumn;
use crate::regression::design_matrix::GAUSS_NEWTON_STEPS;
use crate::regression::design_matrix::{
    columns_of, concatenate, nuisances, residual_after, with_residuals,
};
use crate::regression::normal_equations::{SchurComplement, solve_ridge, weighted_gram};
use crate::residual_model::Columns;
use crate::residual_model::ResidualModel;

/// Least log-evidence of a signal for an effect with per-signal parameters to act
/// on it.
const MIN_ACTING_EVIDENCE: f64 = 4.0;

/// Fits all parameters together: nuisances of each signal, effects of each signal
/// by itself, and effects that the signals share; gives the nuisances.
pub(crate) fn fit_jointly<S: ResidualModel>(
    recordings: &[S],
    found: &mut [FittedEffect<S>],
    newest: Option<&[f64]>,
) -> Vec<Vec<f64>> {
    let signals = recordings[0].residuals().len();
    let base = nuisances(recordings, found);
    let residuals: Vec<Vec<f64>> = (0..signals)
        .map(|k| concatenate(recordings, |s| s.residual(k).to_vec()))
        .collect();
    if let (Some(gains), Some(last)) = (newest, found.last_mut()) {
        // Which signals the newest one acts on.
        let least = MIN_ACTING_EVIDENCE.max(0.005 * gains.iter().copied().fold(0.0, f64::max));
        last.parameters = (0..signals)
            .map(|k| {
                let acts_on = last.effect.scope() == Scope::Machine || gains[k] > least;
                vec![
                    0.0;
                    if acts_on {
                        last.effect.linear_parameters().len()
                    } else {
                        0
                    }
                ]
            })
            .collect();
    }
    let linear =
        |f: &FittedEffect<S>| f.effect.is_linear() && !is_free_signal(recordings, f.effect);
    let turns = if found.len() == 1 && found[0].effect.is_linear() || found.iter().all(linear) {
        1
    } else {
        GAUSS_NEWTON_STEPS
    };
    let mut nuisance = Vec::new();
    for _ in 0..turns {
        let all = columns_of(recordings, found);
        let normals: Vec<Normal> = (0..signals)
            .map(|k| {
                let weight = recordings[0].noise_std(k).powi(-2);
                let effective_samples = 1.0 / recordings[0].samples_per_independent(k);
                Normal::new(
                    k,
                    weight,
                    effective_samples,
                    &base[k],
                    &residuals[k],
                    found,
                    &all,
                )
            })
            .collect();
        let shared = shared_parameters(found, &normals);
        nuisance = normals
            .iter()
            .enumerate()
            .map(|(k, normal)| {
                let own = normal.own(&shared);
                let (zeros, mut own) = (own[..base[k].len()].to_vec(), &own[base[k].len()..]);
                let mut all_shared = shared.as_slice();
                for (f, columns) in found.iter_mut().zip(&all) {
                    let count = columns.len();
                    match f.effect.scope() {
                        Scope::PerSignal if acts_on(f, columns, k) => {
                            f.parameters[k] = own[..count].to_vec();
                            own = &own[count..];
                        }
                        Scope::PerSignal => {}
                        Scope::Machine => {
                            let known = acts_on(f, columns, k);
                            f.parameters[k] = all_shared[..if known { count } else { 0 }].to_vec();
                            all_shared = &all_shared[count..];
                        }
                    }
                }
                zeros
            })
            .collect();
    }
    nuisance
}

/// Whether `f` predicts signal `k`.
pub(crate) fn acts_on<S: ResidualModel>(
    f: &FittedEffect<S>,
    columns: &[Columns],
    k: usize,
) -> bool {
    !f.parameters[k].is_empty() && columns.iter().all(|c| !c[k].is_empty())
}

/// Normal equations of one signal, its own columns eliminated from the shared ones.
struct Normal {
    /// Own parameters beside the shared ones, whose products these are.
    eliminated: SchurComplement,
    /// Place of each shared column among all shared parameters.
    places: Vec<usize>,
    /// Weight of its normal equations.
    weight: f64,
}

impl Normal {
    /// Of signal `k` with `weight` for each sample, of which the part `effective_samples` is new.
    fn new<S: ResidualModel>(
        k: usize,
        weight: f64,
        effective_samples: f64,
        base: &[PriorColumn],
        residual: &[f64],
        found: &[FittedEffect<S>],
        all: &[Vec<Columns>],
    ) -> Self {
        let mut own: Vec<(&[f64], f64)> =
            base.iter().map(|p| (p.column.as_slice(), p.std)).collect();
        let (mut shared, mut places) = (Vec::new(), Vec::new());
        let (mut place, mut overdispersion) = (0, 1.0_f64);
        for (f, columns) in found.iter().zip(all) {
            let is_shared = f.effect.scope() == Scope::Machine;
            if acts_on(f, columns, k) {
                if is_shared {
                    shared.extend(columns.iter().map(|c| c[k].as_slice()));
                    places.extend(place..place + columns.len());
                    overdispersion = overdispersion.max(f.overdispersion[k]);
                } else {
                    let linear = f.effect.linear_parameters().iter();
                    own.extend(
                        linear
                            .zip(columns)
                            .map(|(l, c)| (c[k].as_slice(), l.prior_std)),
                    );
                }
            }
            place += if is_shared { columns.len() } else { 0 };
        }
        let columns: Vec<&[f64]> = own.iter().map(|o| o.0).chain(shared).collect();
        let (gram, right) = weighted_gram(&columns, residual, weight);
        let ridge: Vec<f64> = (own.iter())
            .map(|(_, std)| 1.0 / (effective_samples * std * std))
            .collect();
        Self {
            eliminated: SchurComplement::new(&gram, &right, &ridge),
            places,
            weight: effective_samples / overdispersion,
        }
    }

    /// Own parameters beside the shared ones.
    fn own(&self, shared: &[f64]) -> Vec<f64> {
        let SchurComplement { by, free, .. } = &self.eliminated;
        (0..free.nrows())
            .map(|i| {
                let shared_part = self.places.iter().enumerate();
                let shared_part: f64 = shared_part.map(|(j, p)| by[(i, j)] * shared[*p]).sum();
                free[(i, 0)] - shared_part
            })
            .collect()
    }
}

/// The parameters that all signals share, effect by effect.
fn shared_parameters<S: ResidualModel>(found: &[FittedEffect<S>], normals: &[Normal]) -> Vec<f64> {
    let ridge: Vec<f64> = found
        .iter()
        .filter(|f| f.effect.scope() == Scope::Machine)
        .flat_map(|f| f.effect.linear_parameters())
        .map(|l| 1.0 / (l.prior_std * l.prior_std))
        .collect();
    let c = ridge.len();
    let mut gram = Mat::<f64>::zeros(c, c);
    let mut right = Mat::<f64>::zeros(c, 1);
    for normal in normals {
        let SchurComplement {
            own,
            right: projected,
            ..
        } = &normal.eliminated;
        for (i, a) in normal.places.iter().enumerate() {
            right[(*a, 0)] += normal.weight * projected[(i, 0)];
            for (j, b) in normal.places.iter().enumerate() {
                gram[(*a, *b)] += normal.weight * own[(i, j)];
            }
        }
    }
    let solution = solve_ridge(gram, &right, &ridge);
    (0..c).map(|i| solution[(i, 0)]).collect()
}

/// Residuals of `recordings` less nuisances and effects: `[recording][signal]`.
pub(crate) fn residuals_after<S: ResidualModel>(
    recordings: &[S],
    found: &[FittedEffect<S>],
    nuisance: &[Vec<f64>],
) -> Vec<Vec<Vec<f64>>> {
    let base = nuisances(recordings, found);
    let all = columns_of(recordings, found);
    let effects = found.iter().zip(all.iter().map(Vec::as_slice));
    residual_after(recordings, &base, nuisance, &effects.collect::<Vec<_>>())
}

/// `recordings` with what nuisances and effects leave as their residuals.
pub(crate) fn subtract_effects<S: ResidualModel>(
    recordings: &[S],
    found: &[FittedEffect<S>],
    nuisance: &[Vec<f64>],
) -> Vec<S> {
    with_residuals(recordings, residuals_after(recordings, found, nuisance))
}
