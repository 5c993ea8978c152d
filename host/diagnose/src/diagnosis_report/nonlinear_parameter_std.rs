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
use crate::selection::parameter_search::last_step;

/// Blocks of the recording whose scores show how much the estimate varies.
const BLOCKS: usize = 24;

/// Standard deviations of the shape of `found`: `sqrt(diag (X' W X)^-1)`, with `X` the derivatives of what the effect
/// predicts after each parameter, linear and nonlinear, about those fitted (Gauss-Newton).
///
/// To this adds the resolution of the search, the variance of a uniform distribution over its last step. Weights as of [`parameter_stds`](crate::assessment::parameter_std::parameter_stds). None for a parameter that only
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
    let mut total = Information::zeros(shapes);
    let mut shared: Option<Information> = None;
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
        let signal = Information {
            gram: weighted_gram(&all, &left, weight).0,
            scores: block_scores(&all, &left, weight),
        };
        match found.effect.scope() {
            Scope::PerSignal => total.add(&signal.eliminated(here.len())),
            Scope::Machine => match &mut shared {
                Some(sum) => sum.add(&signal),
                None => shared = Some(signal),
            },
        }
    }
    if let Some(shared) = shared {
        total = shared.eliminated(here.len());
    }
    let variances = total.variances();
    let mut stds = vec![None; parameters.len()];
    for (a, &j) in free.iter().enumerate() {
        let (low, high) = parameters[j].bounds;
        // A deviation as wide as the range says nothing.
        let resolution = last_step(&parameters[j], found.shape[j]).powi(2) / 12.0;
        let std = (variances[a] + resolution).sqrt();
        stds[j] = Some(std).filter(|std| *std > 0.0 && *std < high - low);
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
    // No wider: an oscillation would turn by more than its phase.
    let step = last_step(parameter, value);
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

/// Gram matrix of the parameters, and the score of each block of samples, one a column.
struct Information {
    gram: Mat<f64>,
    scores: Mat<f64>,
}

impl Information {
    fn zeros(parameters: usize) -> Self {
        Self {
            gram: Mat::zeros(parameters, parameters),
            scores: Mat::zeros(parameters, BLOCKS),
        }
    }

    fn add(&mut self, other: &Self) {
        self.gram += &other.gram;
        self.scores += &other.scores;
    }

    /// That on the last parameters with the first `count` free as well (Schur complement).
    fn eliminated(&self, count: usize) -> Self {
        let last = self.gram.nrows() - count;
        let own = self.gram.submatrix(0, 0, count, count);
        let mixed = self.gram.submatrix(0, count, count, last);
        let reduce = mixed.transpose() * own.partial_piv_lu().inverse();
        Self {
            gram: self.gram.submatrix(count, count, last, last) - &reduce * mixed,
            scores: self.scores.submatrix(count, 0, last, BLOCKS)
                - &reduce * self.scores.submatrix(0, 0, count, BLOCKS),
        }
    }

    /// Variances of the parameters, the larger of two: `G^-1`, as for noise that is alike everywhere, and
    /// `G^-1 (sum_b s_b s_b') G^-1`, which holds where the noise differs between blocks and signals share it.
    ///
    /// Source: White 1980, A heteroskedasticity-consistent covariance matrix estimator.
    fn variances(&self) -> Vec<f64> {
        let inverse = self.gram.partial_piv_lu().inverse();
        let moved = &inverse * &self.scores;
        let correction = BLOCKS as f64 / (BLOCKS - 1) as f64;
        (0..inverse.nrows())
            .map(|a| {
                let squares: f64 = (0..BLOCKS).map(|b| moved[(a, b)].powi(2)).sum();
                inverse[(a, a)].max(correction * squares)
            })
            .collect()
    }
}

/// `weight sum x r` of each block, `r` of the samples that are known.
fn block_scores(columns: &[&[f64]], left: &[f64], weight: f64) -> Mat<f64> {
    let mut scores = Mat::zeros(columns.len(), BLOCKS);
    for (i, r) in left.iter().enumerate().filter(|(_, r)| r.is_finite()) {
        let block = i * BLOCKS / left.len();
        for (a, column) in columns.iter().enumerate() {
            scores[(a, block)] += weight * column[i] * r;
        }
    }
    scores
}
