//! Fits the coefficients of columns with normal priors by least squares (Bayesian): on all data,
//! and with each fold left out, whose squared errors it sums by stretch. Columns are grouped by
//! effect.

use faer::linalg::solvers::Solve;
use faer::{Mat, Side};

use crate::design_matrix::Dataset;

/// Columns of a model, and how large their contribution may be.
#[derive(Clone, Default)]
pub struct Columns {
    values: Vec<Vec<f64>>,
    /// Standard deviation of each column's contribution, in parts of the drive's RMS.
    prior: Vec<f64>,
}

impl Columns {
    /// Columns that belong together, with the prior of each.
    pub fn push(&mut self, group: &[Vec<f64>], prior: &[f64]) {
        self.values.extend(group.iter().cloned());
        self.prior.extend(prior);
    }

    /// With a further group.
    #[must_use]
    pub fn with(&self, group: &[Vec<f64>], prior: &[f64]) -> Self {
        let mut columns = self.clone();
        columns.push(group, prior);
        columns
    }

    /// With those of another model.
    #[must_use]
    pub fn and(&self, other: &Self) -> Self {
        self.with(&other.values, &other.prior)
    }

    /// Those from number `first` on.
    #[must_use]
    pub fn after(&self, first: usize) -> Self {
        Self {
            values: self.values[first..].to_vec(),
            prior: self.prior[first..].to_vec(),
        }
    }

    /// Number of columns.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Each column with its prior.
    pub fn with_priors(&self) -> impl Iterator<Item = (&Vec<f64>, f64)> {
        self.values.iter().zip(self.prior.iter().copied())
    }

    /// `sum_k c_k column_k`.
    pub fn times(&self, c: &[f64], rows: usize) -> Vec<f64> {
        let mut sum = vec![0.0; rows];
        for (column, c) in self.values.iter().zip(c) {
            for (s, x) in sum.iter_mut().zip(column) {
                *s += c * x;
            }
        }
        sum
    }
}

/// A prior for each of `count` columns that share a contribution of `total`.
pub fn shared(count: usize, total: f64) -> Vec<f64> {
    vec![total / (count.max(1) as f64).sqrt(); count]
}

/// Coefficients, and how well they do on what they were not fitted to.
pub struct Fit {
    /// One for each column, fitted to everything.
    pub coefficients: Vec<f64>,
    /// Second moment of each column's contribution, in parts of the drive's RMS
    /// squared, as far as columns do not overlap.
    pub relevance: Vec<f64>,
    /// Sum over the squares of what is unexplained.
    pub squares: f64,
    /// Squared errors of values that were left out, by stretch.
    pub left_out: Vec<f64>,
}

impl Fit {
    /// Squared error of everything that was left out.
    pub fn left_out_squares(&self) -> f64 {
        self.left_out.iter().sum()
    }
}

/// Minimises `|y - A c|^2 / sigma^2 + |c / s|^2`, where `s` bounds each column's
/// contribution by its prior; then again with each fold left out.
///
/// `y`: what is to be explained; `noise_variance`: `sigma^2`, the variance of
/// what is unexplained times its correlation time in rows.
pub fn fit(columns: &Columns, y: &[f64], table: &Dataset, noise_variance: f64) -> Fit {
    let n = y.len();
    let p = columns.len();
    let mean_square = y.iter().map(|y| y * y).sum::<f64>() / n as f64;
    // Columns of unit RMS: what they measure may be newton metres or microns.
    let scale: Vec<f64> = columns
        .values
        .iter()
        .map(|c| (c.iter().map(|x| x * x).sum::<f64>() / n as f64).sqrt())
        .map(|s| if s > 0.0 { s } else { 1.0 })
        .collect();
    let folds = table.fold.iter().max().map_or(0, |f| f + 1);
    let moments: Vec<(Mat<f64>, Mat<f64>)> = (0..folds)
        .map(|fold| {
            let rows: Vec<usize> = (0..n).filter(|&i| table.fold[i] == fold).collect();
            let a = Mat::from_fn(rows.len(), p, |r, k| columns.values[k][rows[r]] / scale[k]);
            let b = Mat::from_fn(rows.len(), 1, |r, _| y[rows[r]]);
            (a.transpose() * &a, a.transpose() * &b)
        })
        .collect();
    let mut gram = Mat::<f64>::zeros(p, p);
    let mut right = Mat::<f64>::zeros(p, 1);
    for (g, r) in &moments {
        gram += g;
        right += r;
    }
    let solved = |without: Option<&(Mat<f64>, Mat<f64>)>| -> Vec<f64> {
        let (mut g, mut r) = (gram.clone(), right.clone());
        if let Some((out, b)) = without {
            g -= out;
            r -= b;
        }
        for k in 0..p {
            let spread = columns.prior[k] * columns.prior[k] * mean_square;
            g[(k, k)] += noise_variance / spread.max(f64::MIN_POSITIVE) + 1e-9 * n as f64;
        }
        match g.llt(Side::Lower) {
            Ok(factor) => {
                let c = factor.solve(&r);
                (0..p).map(|k| c[(k, 0)] / scale[k]).collect()
            }
            Err(_) => vec![0.0; p],
        }
    };
    let coefficients = solved(None);
    let relevance = (0..p)
        .map(|k| {
            let precision = n as f64
                + noise_variance / (columns.prior[k].powi(2) * mean_square).max(f64::MIN_POSITIVE);
            ((coefficients[k] * scale[k]).powi(2) + noise_variance / precision) / mean_square
        })
        .collect();
    let explained = columns.times(&coefficients, n);
    let squares = y.iter().zip(&explained).map(|(y, e)| (y - e).powi(2)).sum();
    let stretches = table.stretch.iter().max().map_or(0, |s| s + 1);
    let mut left_out = vec![0.0; stretches];
    for (fold, moment) in moments.iter().enumerate() {
        let c = solved(Some(moment));
        let rows: Vec<usize> = (0..n).filter(|&i| table.fold[i] == fold).collect();
        let mut rest: Vec<f64> = rows.iter().map(|&i| y[i]).collect();
        for (column, c) in columns.values.iter().zip(&c) {
            for (rest, &i) in rest.iter_mut().zip(&rows) {
                *rest -= c * column[i];
            }
        }
        // The offset of a recording that is left out whole is not predicted by others.
        let spread = table.left_out_offset.powi(2) * mean_square;
        if spread > 0.0 {
            let count = rows.len() as f64;
            let offset = rest.iter().sum::<f64>() / (count + noise_variance / spread);
            for rest in &mut rest {
                *rest -= offset;
            }
        }
        for (rest, &i) in rest.iter().zip(&rows) {
            left_out[table.stretch[i]] += rest * rest;
        }
    }
    Fit {
        coefficients,
        relevance,
        squares,
        left_out,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(n: usize) -> Dataset {
        Dataset {
            drive: vec![0.0; n],
            fold: (0..n).map(|i| i / 8 % 10).collect(),
            stretch: (0..n).map(|i| i * 16 / n).collect(),
            t: vec![0.0; n],
            recording: vec![0; n],
            left_out_offset: 0.0,
        }
    }

    #[test]
    fn a_line_is_found_and_predicted() {
        let x: Vec<f64> = (0..400).map(|i| f64::from(i % 37) - 18.0).collect();
        let y: Vec<f64> = x.iter().map(|x| 3.0 + 0.5 * x).collect();
        let mut columns = Columns::default();
        columns.push(&[vec![1.0; 400], x], &[10.0; 2]);
        let fit = fit(&columns, &y, &table(400), 1e-9);
        assert!(
            (fit.coefficients[0] - 3.0).abs() < 1e-6,
            "{:?}",
            fit.coefficients
        );
        assert!((fit.coefficients[1] - 0.5).abs() < 1e-6);
        assert!(fit.left_out_squares() < 1e-8);
    }

    /// As many columns as rows that are noise: what is left out gets worse, not better.
    #[test]
    fn noise_does_not_predict_noise() {
        let noise = |k: usize, i: usize| {
            ((i * 7919 + k * 104_729 + i * k * 31) % 1009) as f64 / 504.5 - 1.0
        };
        let y: Vec<f64> = (0..160).map(|i| noise(500, i)).collect();
        let none = fit(&Columns::default(), &y, &table(160), 0.3);
        let mut columns = Columns::default();
        let group: Vec<Vec<f64>> = (1..60)
            .map(|k| (0..160).map(|i| noise(k, i)).collect())
            .collect();
        columns.push(&group, &[10.0; 59]);
        let many = fit(&columns, &y, &table(160), 0.3);
        assert!(many.squares < 0.8 * none.squares);
        assert!(many.left_out_squares() > none.left_out_squares());
    }
}
