//! Standard deviations of the nonlinear parameters of a fitted effect, by the numerical derivatives
//! of its prediction (Gauss-Newton) with the linear parameters eliminated.

use faer::Mat;
use faer::linalg::solvers::DenseSolveCore;

use crate::candidate_effect::fitted::FittedEffect;
use crate::candidate_effect::{NonlinearParameter, Scope};
use crate::regression::design_matrix::columns;
use crate::regression::joint_fit::acts_on;
use crate::regression::normal_equations::weighted_gram;
use crate::residual_model::ResidualModel;

/// Step of the numerical derivative, in parts of the parameter or of its bounds.
const STEP: f64 = 1e-2;

/// Standard deviations of the shape of `found`: `sqrt(diag (X' W X)^-1)`, with `X` the derivatives of what the effect
/// predicts after each parameter, linear and nonlinear, about those fitted (Gauss-Newton).
///
/// Weights as of [`parameter_stds`](crate::assessment::parameter_std::parameter_stds). None for a parameter that only
/// has the values of a grid, or that the recordings do not determine.
///
/// Source: Seber, Wild 1989, Nonlinear Regression, eq. (2.20).
pub(super) fn shape_stds<S: ResidualModel>(
    recordings: &[S],
    found: &FittedEffect<S>,
    residuals_after: &[Vec<Vec<f64>>],
) -> Vec<Option<f64>> {
    let parameters = found.effect.nonlinear_parameters();
    let free: Vec<usize> = (0..parameters.len())
        .filter(|j| parameters[*j].step > 0.0)
        .collect();
    let here = columns(recordings, found.effect, &found.shape, &found.parameters);
    let slopes: Vec<Vec<Vec<f64>>> = free
        .iter()
        .map(|&j| slope(recordings, found, &parameters[j], j))
        .collect();
    let shapes = free.len();
    // The information of each signal on its own linear parameters, then on the shape.
    let mut of_shape = Mat::<f64>::zeros(shapes, shapes);
    let mut shared: Option<Mat<f64>> = None;
    for k in 0..found.parameters.len() {
        if !acts_on(found, &here, k) {
            continue;
        }
        let left: Vec<f64> = (residuals_after.iter())
            .flat_map(|recording| recording[k].clone())
            .collect();
        let known: Vec<f64> = left.iter().copied().filter(|r| r.is_finite()).collect();
        let square: f64 = known.iter().map(|r| r * r).sum();
        let samples_per_independent =
            recordings[0].samples_per_independent(k) * found.overdispersion[k];
        let weight = known.len().max(1) as f64 / (square.max(1e-300) * samples_per_independent);
        let all: Vec<&[f64]> = (here.iter().map(|c| c[k].as_slice()))
            .chain(slopes.iter().map(|s| s[k].as_slice()))
            .collect();
        let gram = weighted_gram(&all, &left, weight).0;
        match found.effect.scope() {
            Scope::PerSignal => of_shape += eliminated(&gram, here.len()),
            Scope::Machine => match &mut shared {
                Some(sum) => *sum += &gram,
                None => shared = Some(gram),
            },
        }
    }
    if let Some(gram) = shared {
        of_shape = eliminated(&gram, here.len());
    }
    let covariance = of_shape.partial_piv_lu().inverse();
    let mut stds = vec![None; parameters.len()];
    for (a, &j) in free.iter().enumerate() {
        let (low, high) = parameters[j].bounds;
        // A deviation as wide as the range says nothing.
        stds[j] = Some(covariance[(a, a)].sqrt()).filter(|std| *std > 0.0 && *std < high - low);
    }
    stds
}

/// Derivative of what the effect predicts after its nonlinear parameter `j`, `[signal][sample]`.
fn slope<S: ResidualModel>(
    recordings: &[S],
    found: &FittedEffect<S>,
    parameter: &NonlinearParameter,
    j: usize,
) -> Vec<Vec<f64>> {
    let (low, high) = parameter.bounds;
    let value = found.shape[j];
    let step = STEP
        * if value == 0.0 {
            high - low
        } else {
            value.abs()
        };
    let [below, above] = [(value - step).max(low), (value + step).min(high)];
    let predicted = |at: f64| -> Vec<Vec<f64>> {
        let mut shape = found.shape.clone();
        shape[j] = at;
        let columns = columns(recordings, found.effect, &shape, &found.parameters);
        (0..found.parameters.len())
            .map(|k| {
                let terms = columns.iter().zip(&found.parameters[k]);
                let mut sum: Vec<f64> = Vec::new();
                for (column, parameter) in terms {
                    sum.resize(column[k].len(), 0.0);
                    for (sum, x) in sum.iter_mut().zip(&column[k]) {
                        *sum += parameter * x;
                    }
                }
                sum
            })
            .collect()
    };
    let (there, here) = (predicted(above), predicted(below));
    (there.iter().zip(&here))
        .map(|(a, b)| {
            a.iter()
                .zip(b)
                .map(|(a, b)| (a - b) / (above - below))
                .collect()
        })
        .collect()
}

/// Information on the last parameters with the first `count` free as well (Schur complement).
fn eliminated(gram: &Mat<f64>, count: usize) -> Mat<f64> {
    let rest = gram.nrows() - count;
    let own = gram.submatrix(0, 0, count, count);
    let mixed = gram.submatrix(0, count, count, rest);
    let last = gram.submatrix(count, count, rest, rest);
    last - mixed.transpose() * own.partial_piv_lu().inverse() * mixed
}
