//! Weighted least squares of plateau means and of changes within plateaus, two kinds of
//! observations each with a variance of its own; estimates with standard deviation and degrees of
//! freedom, and the test of a term that is not in the model yet.

use loadtwin_math::metrics::{student_both_tails, student_quantile};

/// Kinds of observations: means of plateaus, changes within them.
pub(super) const KINDS: usize = 2;

/// Part of a column that has to be independent of those before it.
const INDEPENDENT: f64 = 1e-6;

/// Least variance of an observation in parts of the square of the readings: rounding.
const ROUNDING: f64 = 1e-24;

/// Searches for the variances; each changes them by less than a hundredth after a few.
const PASSES: usize = 8;

/// What is fitted: one entry for each plateau mean, or change within a plateau.
#[derive(Clone, Debug, Default)]
pub(super) struct Observed {
    /// Reading.
    pub reading: Vec<f64>,
    /// Known part of its variance, of samples or of the converter.
    pub variance: Vec<f64>,
    /// Its kind, below [`KINDS`].
    pub kind: Vec<usize>,
}

/// A quantity with its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The value.
    pub value: f64,
    /// Its standard deviation.
    pub std: f64,
    /// Degrees of freedom of the standard deviation.
    pub freedom: f64,
}

impl Estimate {
    /// 95 % interval by Student's t.
    pub fn interval(&self) -> [f64; 2] {
        let half = self.std * student_quantile(self.freedom.max(1.0), 0.05);
        [self.value - half, self.value + half]
    }

    /// In another unit.
    #[must_use]
    pub fn times(self, factor: f64) -> Self {
        Self {
            value: self.value * factor,
            std: self.std * factor.abs(),
            ..self
        }
    }
}

/// Student's t of a term that is tried.
#[derive(Clone, Copy, Debug)]
pub(super) struct Test {
    /// Magnitude over standard deviation.
    pub t: f64,
    /// Probability of as large a value without the term.
    pub p_value: f64,
}

/// A weighted least-squares fit `W^(1/2) X = Q R`.
///
/// `var y_i = v_k + s_i^2`: `s_i^2` is known, `v_k >= 0` is that of its kind, such that the squared
/// residuals are as large as their degrees of freedom, `sum_i (1 - h_ii)`.
///
/// Source: Mandel and Paule 1970, Interlaboratory evaluation of a material with unequal numbers of
/// replicates (variances).
pub(super) struct Fit {
    /// Orthonormal columns; none where a column depends on those before it.
    q: Vec<Option<Vec<f64>>>,
    /// Upper triangle, by columns.
    r: Vec<Vec<f64>>,
    /// `1 / sqrt(var y_i)`.
    weights: Vec<f64>,
    kind: Vec<usize>,
    /// Known part of the weighted variance of each kind, of 1: below it no variance is found.
    known: [f64; KINDS],
    residual: Vec<f64>,
    freedom: [f64; KINDS],
    /// Found over assumed variance of each kind.
    scale: [f64; KINDS],
    /// `v_k`.
    variance: [f64; KINDS],
    /// Of the columns; 0 of one that was left out.
    pub coefficients: Vec<f64>,
}

impl Fit {
    /// Fits `columns` with variances found from their residuals.
    pub(super) fn new(columns: &[Vec<f64>], observed: &Observed) -> Self {
        let rounding = ROUNDING * observed.reading.iter().map(|y| y * y).fold(0.0, f64::max);
        let mut variance = [1.0; KINDS];
        let mut fit = Self::weighted(columns, observed, variance, rounding);
        // With weights of one kind that are all equal the first variance is the last.
        for _ in 0..PASSES {
            for (k, variance) in variance.iter_mut().enumerate() {
                let squares: Vec<(f64, f64)> = (0..observed.reading.len())
                    .filter(|&i| observed.kind[i] == k)
                    .map(|i| {
                        let own = fit.residual[i] / fit.weights[i];
                        (own * own, observed.variance[i])
                    })
                    .collect();
                *variance = unknown_variance(&squares, fit.freedom[k]);
            }
            fit = Self::weighted(columns, observed, variance, rounding);
        }
        fit
    }

    /// As [`Fit::new`] with the variances of `self`.
    pub(super) fn again(&self, columns: &[Vec<f64>], observed: &Observed) -> Self {
        let rounding = ROUNDING * observed.reading.iter().map(|y| y * y).fold(0.0, f64::max);
        Self::weighted(columns, observed, self.variance, rounding)
    }

    fn weighted(
        columns: &[Vec<f64>],
        observed: &Observed,
        variance: [f64; KINDS],
        rounding: f64,
    ) -> Self {
        let kind = observed.kind.clone();
        let (mut known, mut count) = ([0.0; KINDS], [0.0_f64; KINDS]);
        let mut weights = Vec::with_capacity(kind.len());
        for (k, s2) in kind.iter().zip(&observed.variance) {
            let total = (variance[*k] + s2).max(rounding).max(f64::MIN_POSITIVE);
            weights.push(1.0 / total.sqrt());
            known[*k] += s2.max(rounding) / total;
            count[*k] += 1.0;
        }
        let mut fit = Self {
            q: Vec::new(),
            r: Vec::new(),
            known: [0, 1].map(|k| known[k] / count[k].max(1.0)),
            residual: product(&weights, &observed.reading),
            weights,
            kind,
            freedom: count,
            scale: [1.0; KINDS],
            variance,
            coefficients: vec![0.0; columns.len()],
        };
        let mut projections = Vec::new();
        for column in columns {
            let mut own = product(&fit.weights, column);
            let size = norm(&own);
            let r = fit.orthogonalise(&mut own);
            let left = norm(&own);
            let is_independent = left > INDEPENDENT * size;
            fit.r.push(r);
            if is_independent {
                scale_by(&mut own, 1.0 / left);
                let projection = dot(&own, &fit.residual);
                for ((residual, q), k) in fit.residual.iter_mut().zip(&own).zip(&fit.kind) {
                    *residual -= projection * q;
                    fit.freedom[*k] -= q * q;
                }
                if let Some(r) = fit.r.last_mut() {
                    r.push(left);
                }
                projections.push(projection);
                fit.q.push(Some(own));
            } else {
                projections.push(0.0);
                fit.q.push(None);
            }
        }
        fit.coefficients = fit.solved(projections);
        let squares = fit.squares(&fit.residual);
        fit.scale = [0, 1].map(|k| scale(squares[k], fit.freedom[k], fit.known[k]));
        fit
    }

    /// Takes the columns so far out of `own`, twice against rounding; their parts in it.
    fn orthogonalise(&self, own: &mut [f64]) -> Vec<f64> {
        let mut r = vec![0.0; self.q.len()];
        for _ in 0..2 {
            for (q, r) in self.q.iter().zip(&mut r) {
                if let Some(q) = q {
                    let part = dot(q, own);
                    *r += part;
                    own.iter_mut().zip(q).for_each(|(x, q)| *x -= part * q);
                }
            }
        }
        r
    }

    /// `R^-1 x`; 0 of columns that were left out.
    fn solved(&self, mut x: Vec<f64>) -> Vec<f64> {
        for j in (0..x.len()).rev() {
            if self.q[j].is_none() {
                x[j] = 0.0;
                continue;
            }
            x[j] /= self.r[j][j];
            let (above, value) = x.split_at_mut(j);
            for (i, above) in above.iter_mut().enumerate() {
                *above -= self.r[j][i] * value[0];
            }
        }
        x
    }

    /// `R^-T c`.
    fn solved_transposed(&self, c: &[f64]) -> Vec<f64> {
        let mut x = vec![0.0; c.len()];
        for j in 0..c.len() {
            if self.q[j].is_some() {
                let before: f64 = (0..j).map(|i| self.r[j][i] * x[i]).sum();
                x[j] = (c[j] - before) / self.r[j][j];
            }
        }
        x
    }

    /// Sum of squared weighted residuals.
    pub(super) fn sum_of_squares(&self) -> f64 {
        dot(&self.residual, &self.residual)
    }

    /// `sum_i ln(var y_i) + e_i^2 / var y_i`: twice the negative logarithm of the likelihood, but for a
    /// constant.
    pub(super) fn deviance(&self) -> f64 {
        self.sum_of_squares() - 2.0 * self.weights.iter().map(|w| w.ln()).sum::<f64>()
    }

    /// Degrees of freedom of the residuals.
    pub(super) fn freedom(&self) -> f64 {
        self.freedom.iter().sum()
    }

    /// Standard deviation of a plateau mean about the model.
    pub(super) fn deviation(&self) -> f64 {
        let of_means = || (0..self.kind.len()).filter(|&i| self.kind[i] == 0);
        let squares: f64 = of_means()
            .map(|i| (self.residual[i] / self.weights[i]).powi(2))
            .sum();
        (squares / self.freedom[0].max(1.0)).sqrt()
    }

    /// Whether column `j` is independent of those before it.
    pub(super) fn is_independent(&self, j: usize) -> bool {
        self.q[j].is_some()
    }

    fn squares(&self, of: &[f64]) -> [f64; KINDS] {
        let mut sums = [0.0; KINDS];
        for (x, k) in of.iter().zip(&self.kind) {
            sums[*k] += x * x;
        }
        sums
    }

    /// `c' coefficients`, with the variance of each kind as found and Satterthwaite's degrees of
    /// freedom.
    ///
    /// Source: Satterthwaite 1946, An approximate distribution of estimates of variance components.
    pub(super) fn linear(&self, c: &[f64]) -> Estimate {
        let x = self.solved_transposed(c);
        let mut parts = vec![0.0; self.kind.len()];
        for (q, x) in self.q.iter().zip(&x) {
            if let Some(q) = q {
                parts.iter_mut().zip(q).for_each(|(sum, q)| *sum += x * q);
            }
        }
        let value = dot(c, &self.coefficients);
        let squares = self.squares(&parts);
        estimate(
            value,
            [0, 1].map(|k| self.scale[k] * squares[k]),
            self.freedom,
        )
    }

    /// Test of `column` beside those of the model; none where it depends on them, or no degree of
    /// freedom is left.
    pub(super) fn test(&self, column: &[f64]) -> Option<Test> {
        let mut own = product(&self.weights, column);
        let size = norm(&own);
        self.orthogonalise(&mut own);
        let left = norm(&own);
        if left <= INDEPENDENT * size || self.freedom() < 2.0 {
            return None;
        }
        scale_by(&mut own, 1.0 / left);
        let projection = dot(&own, &self.residual);
        let after: Vec<f64> = (self.residual.iter().zip(&own))
            .map(|(residual, q)| residual - projection * q)
            .collect();
        let (squares, taken) = (self.squares(&after), self.squares(&own));
        let freedom = [0, 1].map(|k| self.freedom[k] - taken[k]);
        let variance = [0, 1].map(|k| taken[k] * scale(squares[k], freedom[k], self.known[k]));
        let found = estimate(projection, variance, freedom);
        let t = found.value.abs() / found.std.max(f64::MIN_POSITIVE);
        let p_value = student_both_tails(t, found.freedom);
        Some(Test { t, p_value })
    }
}

/// Found over assumed variance: not less than the `known` part.
fn scale(squares: f64, freedom: f64, known: f64) -> f64 {
    // Half a degree of freedom says nothing of a variance.
    if freedom < 0.5 {
        return 1.0;
    }
    (squares / freedom).max(known)
}

/// Sum of variances, one of each kind, with Satterthwaite's degrees of freedom.
fn estimate(value: f64, variance: [f64; KINDS], freedom: [f64; KINDS]) -> Estimate {
    let total: f64 = variance.iter().sum();
    let weighted: f64 = (0..KINDS)
        .map(|k| variance[k] * variance[k] / freedom[k].max(0.5))
        .sum();
    Estimate {
        value,
        std: total.sqrt(),
        freedom: if weighted > 0.0 {
            total * total / weighted
        } else {
            1.0
        },
    }
}

/// `v >= 0` with `sum_i e_i^2 / (v + s_i^2) = freedom`, by bisection.
fn unknown_variance(squares: &[(f64, f64)], freedom: f64) -> f64 {
    if squares.is_empty() || freedom < 0.5 {
        return 0.0;
    }
    let excess = |v: f64| squares.iter().map(|(e2, s2)| e2 / (v + s2)).sum::<f64>() - freedom;
    let most = squares.iter().map(|(e2, _)| e2).sum::<f64>() / freedom;
    if squares.iter().all(|(_, s2)| *s2 > 0.0) && excess(0.0) <= 0.0 {
        return 0.0;
    }
    let (mut low, mut high) = (0.0, most);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if excess(middle) > 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

fn product(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a * b).collect()
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn scale_by(a: &mut [f64], factor: f64) {
    for x in a {
        *x *= factor;
    }
}

fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: readings 1, 3, 2, 4 at 0, 1, 2, 3: line 1.3 + 0.8 x, squares 1.8 with 2 degrees of
    /// freedom, so the slope has the variance 0.9 / 5.
    #[test]
    fn line_by_hand() {
        let observed = Observed {
            reading: vec![1.0, 3.0, 2.0, 4.0],
            variance: vec![0.0; 4],
            kind: vec![0; 4],
        };
        let columns = [vec![1.0; 4], vec![0.0, 1.0, 2.0, 3.0]];
        let fit = Fit::new(&columns, &observed);
        let slope = fit.linear(&[0.0, 1.0]);
        assert!((fit.coefficients[0] - 1.3).abs() < 1e-12);
        assert!((slope.value - 0.8).abs() < 1e-12);
        assert!((slope.std - 0.18_f64.sqrt()).abs() < 1e-9, "{slope:?}");
        assert!((slope.freedom - 2.0).abs() < 1e-9, "{slope:?}");
        // The test of the slope is the t of the full fit.
        let test = Fit::new(&columns[..1], &observed)
            .test(&columns[1])
            .unwrap();
        assert!((test.t - 0.8 / 0.18_f64.sqrt()).abs() < 1e-9, "{test:?}");
        // The sum of both columns is no third.
        let sum: Vec<f64> = columns[1].iter().map(|x| x + 1.0).collect();
        assert!(fit.test(&sum).is_none());
    }

    /// Means with a known variance of 4 that scatter less: no other variance is found, and the known
    /// one stays.
    #[test]
    fn known_variance_is_enough() {
        let observed = Observed {
            reading: vec![1.5, -1.5, 1.5, -1.5, 0.0],
            variance: vec![4.0; 5],
            kind: vec![0; 5],
        };
        let fit = Fit::new(&[vec![1.0; 5]], &observed);
        assert_eq!(fit.variance[0], 0.0);
        assert!((fit.linear(&[1.0]).std - (4.0_f64 / 5.0).sqrt()).abs() < 1e-9);
    }
}
