//! Solves regularised least squares by normal equations: sums Gram matrices for each fold, and
//! computes ridge solution, cross-validated error and Schur complement.

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};

/// Folds of the cross-validation.
pub const FOLDS: usize = 8;

/// Sums of products of one signal, a set for each fold.
#[derive(Clone)]
pub(crate) struct NormalEquations {
    pub gram: Vec<Mat<f64>>,
    pub right: Vec<Mat<f64>>,
    pub square: Vec<Vec<f64>>,
}

/// How well columns predict one signal, for each right-hand side.
#[derive(Clone)]
pub(crate) struct CrossValidated {
    /// Squared errors on left-out folds.
    pub sse: Vec<f64>,
    /// `sum ridge b^2` of what all folds together say: how far from expected
    /// the parameters are.
    pub prior_penalty: Vec<f64>,
}

/// `sum ridge b^2` over the first rows of each column of `solution`.
pub(crate) fn prior_penalty(solution: &Mat<f64>, ridge: &[f64]) -> Vec<f64> {
    (0..solution.ncols())
        .map(|r| {
            let of = |(i, ridge): (usize, &f64)| ridge * solution[(i, r)].powi(2);
            ridge.iter().enumerate().map(of).sum()
        })
        .collect()
}

/// Predicts each fold from the others.
pub(crate) fn cross_validate(sums: &NormalEquations, ridge: &[f64]) -> CrossValidated {
    let rhs_count = sums.square[0].len();
    let mut sse = vec![0.0; rhs_count];
    let (gram, right) = sum_folds(sums);
    for fold in 0..FOLDS {
        let solution = solve_ridge(
            &gram - &sums.gram[fold],
            &(&right - &sums.right[fold]),
            ridge,
        );
        add(&mut sse, &test_error(sums, fold, &solution));
    }
    let prior_penalty = prior_penalty(&solve_ridge(gram, &right, ridge), ridge);
    CrossValidated { sse, prior_penalty }
}

pub(crate) fn sum_folds(sums: &NormalEquations) -> (Mat<f64>, Mat<f64>) {
    let mut gram = sums.gram[0].clone();
    let mut right = sums.right[0].clone();
    for fold in 1..FOLDS {
        gram += &sums.gram[fold];
        right += &sums.right[fold];
    }
    (gram, right)
}

pub(crate) fn add(sum: &mut [f64], more: &[f64]) {
    for (sum, more) in sum.iter_mut().zip(more) {
        *sum += more;
    }
}

/// Copies the lower triangle into the upper one.
pub(crate) fn symmetrise(gram: &mut Mat<f64>) {
    for i in 0..gram.nrows() {
        for j in 0..i {
            gram[(j, i)] = gram[(i, j)];
        }
    }
}

/// `rr - 2 b'x + b'X b` of one fold, for each right-hand side.
pub(crate) fn test_error(sums: &NormalEquations, fold: usize, solution: &Mat<f64>) -> Vec<f64> {
    let predicted = &sums.gram[fold] * solution;
    (0..solution.ncols())
        .map(|r| {
            let fitted: f64 = (0..solution.nrows())
                .map(|i| solution[(i, r)] * (predicted[(i, r)] - 2.0 * sums.right[fold][(i, r)]))
                .sum();
            sums.square[fold][r] + fitted
        })
        .collect()
}

/// Solves `(gram + ridge) b = right`; columns are scaled to one size first.
/// All zero where the columns do not determine it.
pub(crate) fn solve_ridge(mut gram: Mat<f64>, right: &Mat<f64>, ridge: &[f64]) -> Mat<f64> {
    let (p, rhs_count) = (gram.nrows(), right.ncols());
    for (i, r) in ridge.iter().enumerate() {
        gram[(i, i)] += r;
    }
    let scale: Vec<f64> = (0..p)
        .map(|i| {
            if gram[(i, i)] > 0.0 {
                gram[(i, i)].sqrt()
            } else {
                1.0
            }
        })
        .collect();
    let scaled = Mat::from_fn(p, p, |i, j| {
        gram[(i, j)] / (scale[i] * scale[j]) + if i == j { 1e-10 } else { 0.0 }
    });
    let rhs = Mat::from_fn(p, rhs_count, |i, r| right[(i, r)] / scale[i]);
    match scaled.llt(Side::Lower) {
        Ok(factor) => {
            let solution = factor.solve(&rhs);
            Mat::from_fn(p, rhs_count, |i, r| solution[(i, r)] / scale[i])
        }
        Err(_) => Mat::zeros(p, rhs_count),
    }
}

/// `w X'X` and `w X'y` over the samples where `y` is known.
pub(crate) fn weighted_gram(columns: &[&[f64]], y: &[f64], weight: f64) -> (Mat<f64>, Mat<f64>) {
    let p = columns.len();
    let mut gram = Mat::<f64>::zeros(p, p);
    let mut right = Mat::<f64>::zeros(p, 1);
    for (i, y) in y.iter().enumerate().filter(|(_, y)| y.is_finite()) {
        for (a, x) in columns.iter().enumerate() {
            right[(a, 0)] += weight * x[i] * y;
            for (b, z) in columns[..=a].iter().enumerate() {
                gram[(a, b)] += weight * x[i] * z[i];
            }
        }
    }
    symmetrise(&mut gram);
    (gram, right)
}

/// Normal equations with the first columns, the base, eliminated from the others, the candidate.
pub(crate) struct SchurComplement {
    /// Regression coefficients of the candidate's columns on the base.
    pub by: Mat<f64>,
    /// Regression coefficients of the right-hand sides on the base.
    pub free: Mat<f64>,
    /// Products of the candidate's columns.
    pub own: Mat<f64>,
    /// Products of the candidate's columns with the right-hand sides.
    pub right: Mat<f64>,
}

impl SchurComplement {
    /// Of `gram b = right`, the base having the columns of `ridge`.
    pub fn new(gram: &Mat<f64>, right: &Mat<f64>, ridge: &[f64]) -> Self {
        let q = ridge.len();
        let (c, rhs_count) = (gram.nrows() - q, right.ncols());
        let inner = gram.submatrix(0, 0, q, q).to_owned();
        let cross = gram.submatrix(0, q, q, c);
        let both = Mat::from_fn(q, c + rhs_count, |i, j| {
            if j < c {
                cross[(i, j)]
            } else {
                right[(i, j - c)]
            }
        });
        let solution = solve_ridge(inner, &both, ridge);
        let by = solution.submatrix(0, 0, q, c).to_owned();
        let free = solution.submatrix(0, c, q, rhs_count).to_owned();
        Self {
            own: gram.submatrix(q, q, c, c) - cross.transpose() * &by,
            right: right.submatrix(q, 0, c, rhs_count) - cross.transpose() * &free,
            by,
            free,
        }
    }
}

/// `x y`.
pub(crate) fn dot(x: &[f64], y: &[f64]) -> f64 {
    let [product] = dots_of(x, [y]);
    product
}

/// `x y` of each of `ys`, into `products`.
pub(crate) fn dots<'a>(x: &[f64], ys: impl Iterator<Item = &'a [f64]>, products: &mut Vec<f64>) {
    products.clear();
    let mut waiting: [&[f64]; 4] = [&[]; 4];
    let mut count = 0;
    for y in ys {
        waiting[count] = y;
        count += 1;
        if count == waiting.len() {
            products.extend(dots_of(x, waiting));
            count = 0;
        }
    }
    products.extend(waiting[..count].iter().map(|y| dot(x, y)));
}

/// `x y` of each of `ys`, of the length of `x`: each in four sums, so that it runs in the width of the
/// processor, and several at once, so that none waits for the sum before.
fn dots_of<const N: usize>(x: &[f64], ys: [&[f64]; N]) -> [f64; N] {
    let (xs, rest) = x.as_chunks::<4>();
    let chunks = ys.map(|y| &y.as_chunks::<4>().0[..xs.len()]);
    let mut sums = [[0.0; 4]; N];
    for (i, x) in xs.iter().enumerate() {
        for (sums, y) in sums.iter_mut().zip(&chunks) {
            for lane in 0..4 {
                sums[lane] += x[lane] * y[i][lane];
            }
        }
    }
    std::array::from_fn(|k| {
        let last = rest.iter().zip(&ys[k][x.len() - rest.len()..]);
        let last: f64 = last.map(|(x, y)| x * y).sum();
        sums[k].iter().sum::<f64>() + last
    })
}
