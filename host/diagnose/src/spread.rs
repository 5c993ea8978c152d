//! How sure the parameters of an effect are.

use faer::Mat;
use faer::linalg::solvers::DenseSolveCore;

use super::columns::columns;
use super::effect::Coupling;
use super::observed::Observed;
use super::refit::acts;
use super::select::Found;
use super::sums::products;

/// Standard deviations of the linear parameters of `found` for each stream, with the others as
/// they are: `sqrt(diag (sum X' X / s^2)^-1)`, `s^2` the mean square that is left of a stream in
/// `rest` (`[session][stream]`), over its independent samples.
pub fn spreads<S: Observed>(
    sessions: &[S],
    found: &Found<S>,
    rest: &[Vec<Vec<f64>>],
) -> Vec<Vec<f64>> {
    let columns = columns(sessions, found.effect, &found.shape, &found.parameters);
    let information: Vec<Mat<f64>> = (0..found.parameters.len())
        .map(|k| {
            let left: Vec<f64> = rest.iter().flat_map(|session| session[k].clone()).collect();
            let known = |i: &usize| left[*i].is_finite();
            let count = (0..left.len()).filter(known).count().max(1) as f64;
            let square = (0..left.len())
                .filter(known)
                .map(|i| left[i] * left[i])
                .sum::<f64>();
            let inflation = sessions[0].inflation(k) * found.overdispersion[k];
            let weight = count / (square.max(1e-300) * inflation);
            let own: Vec<&[f64]> = if acts(found, &columns, k) {
                columns.iter().map(|c| c[k].as_slice()).collect()
            } else {
                Vec::new()
            };
            products(&own, &left, weight).0
        })
        .collect();
    let stds = |gram: &Mat<f64>| -> Vec<f64> {
        let inverse = gram.partial_piv_lu().inverse();
        (0..gram.nrows()).map(|a| inverse[(a, a)].sqrt()).collect()
    };
    match found.effect.coupling() {
        Coupling::Own => information.iter().map(stds).collect(),
        Coupling::Shared => {
            let p = found.effect.linear().len();
            let mut all = Mat::<f64>::zeros(p, p);
            for gram in information.iter().filter(|gram| gram.nrows() == p) {
                all += gram;
            }
            let shared = stds(&all);
            let acts = |gram: &Mat<f64>| gram.nrows() == p;
            (information.iter())
                .map(|gram| {
                    if acts(gram) {
                        shared.clone()
                    } else {
                        Vec::new()
                    }
                })
                .collect()
        }
    }
}
