//! Standard deviations of the linear parameters of a fitted effect, from its normal equations and
//! the mean square of the remaining residual.

use faer::Mat;
use faer::linalg::solvers::DenseSolveCore;

use crate::candidate_effect::Scope;
use crate::candidate_effect::fitted::FittedEffect;
use crate::regression::design_matrix::columns;
use crate::regression::joint_fit::acts_on;
use crate::regression::normal_equations::weighted_gram;
use crate::residual_model::ResidualModel;

/// Standard deviations of the linear parameters of `found` for each signal, with the others as
/// they are: `sqrt(diag (sum X' X / s^2)^-1)`, `s^2` the mean square of a signal's residual in
/// `residuals_after` (`[recording][signal]`), over its independent samples.
pub fn parameter_stds<S: ResidualModel>(
    recordings: &[S],
    found: &FittedEffect<S>,
    residuals_after: &[Vec<Vec<f64>>],
) -> Vec<Vec<f64>> {
    let columns = columns(recordings, found.effect, &found.shape, &found.parameters);
    let information: Vec<Mat<f64>> = (0..found.parameters.len())
        .map(|k| {
            let left: Vec<f64> = residuals_after
                .iter()
                .flat_map(|recording| recording[k].clone())
                .collect();
            let known = |i: &usize| left[*i].is_finite();
            let count = (0..left.len()).filter(known).count().max(1) as f64;
            let square = (0..left.len())
                .filter(known)
                .map(|i| left[i] * left[i])
                .sum::<f64>();
            let samples_per_independent =
                recordings[0].samples_per_independent(k) * found.overdispersion[k];
            let weight = count / (square.max(1e-300) * samples_per_independent);
            let own: Vec<&[f64]> = if acts_on(found, &columns, k) {
                columns.iter().map(|c| c[k].as_slice()).collect()
            } else {
                Vec::new()
            };
            weighted_gram(&own, &left, weight).0
        })
        .collect();
    let stds = |gram: &Mat<f64>| -> Vec<f64> {
        let inverse = gram.partial_piv_lu().inverse();
        (0..gram.nrows()).map(|a| inverse[(a, a)].sqrt()).collect()
    };
    match found.effect.scope() {
        Scope::PerSignal => information.iter().map(stds).collect(),
        Scope::Machine => {
            let p = found.effect.linear_parameters().len();
            let mut all = Mat::<f64>::zeros(p, p);
            for gram in information.iter().filter(|gram| gram.nrows() == p) {
                all += gram;
            }
            let shared = stds(&all);
            let acts_on = |gram: &Mat<f64>| gram.nrows() == p;
            (information.iter())
                .map(|gram| {
                    if acts_on(gram) {
                        shared.clone()
                    } else {
                        Vec::new()
                    }
                })
                .collect()
        }
    }
}
