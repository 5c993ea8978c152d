//! Projects nuisance regressors out of residuals and regressors (Frisch-Waugh-Lovell).

use faer::Mat;

use crate::regression::normal_equations::{dot, solve_ridge, symmetrise};
use crate::residual_model::SignalSet;

/// Projection on columns whose parameters all signals share, by weighted least squares:
/// `y - U (U' W U + L)^-1 U' W y`.
///
/// Fitted beside a column without them, the parameters of an effect are those of a fit of
/// both together.
///
/// Source: Frisch and Waugh, Partial time regressions as compared with individual trends,
/// Econometrica 1 (1933).
pub struct NuisanceProjection {
    columns: Vec<SignalSet>,
    /// `W`; 0 where nothing was measured.
    weights: SignalSet,
    ridge: Vec<f64>,
    gram: Mat<f64>,
}

impl NuisanceProjection {
    /// `columns` with the standard deviations that their parameters have, infinite where they
    /// may be anything.
    pub fn new(columns: Vec<SignalSet>, stds: &[f64], weights: SignalSet) -> Self {
        let p = columns.len();
        let mut gram = Mat::<f64>::zeros(p, p);
        for a in 0..p {
            let weighed = weighed(&columns[a], &weights);
            for b in 0..=a {
                gram[(a, b)] = product(&weighed, &columns[b]);
            }
        }
        symmetrise(&mut gram);
        Self {
            columns,
            weights,
            ridge: stds.iter().map(|std| std.powi(-2)).collect(),
            gram,
        }
    }

    /// With `further` columns after them, and the standard deviations of their parameters.
    pub fn with(&self, further: Vec<(SignalSet, f64)>) -> Self {
        let std = |ridge: &f64| ridge.powf(-0.5);
        let mut stds: Vec<f64> = self.ridge.iter().map(std).collect();
        let mut columns = self.columns.clone();
        for (column, std) in further {
            columns.push(column);
            stds.push(std);
        }
        Self::new(columns, &stds, self.weights.clone())
    }

    /// Number of columns.
    pub fn len(&self) -> usize {
        self.columns.len()
    }

    /// Parameters with which the columns explain `readings` best.
    pub fn parameters(&self, readings: &SignalSet) -> Vec<f64> {
        let weighed = weighed(readings, &self.weights);
        let right = Mat::from_fn(self.columns.len(), 1, |a, _| {
            product(&weighed, &self.columns[a])
        });
        let found = solve_ridge(self.gram.clone(), &right, &self.ridge);
        (0..self.columns.len()).map(|a| found[(a, 0)]).collect()
    }

    /// What the columns leave of `readings`.
    pub fn annihilate(&self, mut readings: SignalSet) -> SignalSet {
        for (column, size) in self.columns.iter().zip(self.parameters(&readings)) {
            for (of, column) in readings.iter_mut().zip(column) {
                for (value, column) in of.iter_mut().zip(column) {
                    *value -= size * column;
                }
            }
        }
        readings
    }

    /// `y' W y`.
    pub fn square(&self, readings: &SignalSet) -> f64 {
        product(&weighed(readings, &self.weights), readings)
    }
}

/// `W x`.
fn weighed(x: &SignalSet, weights: &SignalSet) -> SignalSet {
    let of = |(x, w): (&Vec<f64>, &Vec<f64>)| x.iter().zip(w).map(|(x, w)| x * w).collect();
    x.iter().zip(weights).map(of).collect()
}

/// `x' y`; a column that is empty predicts nothing.
fn product(x: &SignalSet, y: &SignalSet) -> f64 {
    let shared = |(x, y): (&Vec<f64>, &Vec<f64>)| {
        let n = x.len().min(y.len());
        dot(&x[..n], &y[..n])
    };
    x.iter().zip(y).map(shared).sum()
}
