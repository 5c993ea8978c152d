//! Computes the complex eigenpairs of the rotor at one speed, on a basis of undamped modes. Gives
//! the least damped eigenvalue, selects the pairs that dominate the free motion after a start, and
//! gives real bases of what the selected ones span.

use faer::linalg::solvers::{PartialPivLu, Solve};
use faer::{Mat, c64};

use crate::rotor::RotorError;
use crate::rotor::fe_model::RotorModel;
use crate::rotor::undamped_mode_reduction::Reduced;

/// Time after which free motion counts less: undamped motion has no end [s].
const COUNTS_S: f64 = 10.0;

/// Eigenpairs of `x' = A x`, `x = (z, z')`, `A u = s u`, at one speed.
pub(crate) struct Eigenpairs {
    a: Mat<f64>,
    values: Vec<c64>,
    vectors: Mat<c64>,
    factor: PartialPivLu<c64>,
}

impl Eigenpairs {
    /// Of a rotor on a fine basis at a speed [rad/s].
    ///
    /// # Errors
    /// [`RotorError::NoEigenvalues`] where numbers are out of proportion.
    pub fn new(model: &RotorModel, fine: &Reduced, speed_rad_s: f64) -> Result<Self, RotorError> {
        let r = fine.len();
        let a = fine.motion(model, speed_rad_s, 1.0, 0);
        // Displacements and speeds in like units, so that the eigenvalues are well conditioned.
        let unit: Vec<f64> = (0..2 * r)
            .map(|i| {
                if i < r {
                    a[(r + i, i)].abs().sqrt().recip()
                } else {
                    1.0
                }
            })
            .collect();
        let alike = Mat::from_fn(2 * r, 2 * r, |i, j| a[(i, j)] * unit[j] / unit[i]);
        let eigen = alike.eigen().map_err(|_| RotorError::NoEigenvalues)?;
        let values: Vec<c64> = (0..2 * r).map(|k| eigen.S()[k]).collect();
        let vectors = Mat::from_fn(2 * r, 2 * r, |i, k| eigen.U()[(i, k)] * unit[i]);
        Ok(Self {
            values,
            factor: vectors.partial_piv_lu(),
            vectors,
            a,
        })
    }

    /// The eigenvalue of what decays least, or grows most.
    pub fn least_damped(&self) -> c64 {
        let least = (self.values.iter().copied()).max_by(|a, b| a.re.total_cmp(&b.re));
        least.unwrap_or_default()
    }

    /// `c` of `x = sum_k c_k u_k`, for each column of `x`.
    fn shares(&self, x: &Mat<f64>) -> Mat<c64> {
        self.factor
            .solve(Mat::from_fn(x.nrows(), x.ncols(), |i, j| {
                c64::new(x[(i, j)], 0.0)
            }))
    }

    /// How many of them swing.
    pub fn swinging(&self) -> usize {
        self.values.iter().filter(|s| swings(**s)).count()
    }

    /// Those that have most of what follows `starts`, a column each, in `count` coordinates; with
    /// or without what does not swing.
    ///
    /// `|c_k|^2 |z_k|^2 / (1 / 10 s - Re s_k)`, summed over the starts: the square of the
    /// displacement over the time that it lasts.
    pub fn leading(&self, starts: &Mat<f64>, count: usize, all: bool) -> Vec<usize> {
        let c = self.shares(starts);
        let square = |z: c64| z.re * z.re + z.im * z.im;
        let mut ranked: Vec<(usize, f64)> = (self.values.iter().enumerate())
            .filter(|(_, s)| swings(**s) || all && s.im >= 0.0)
            .map(|(k, s)| {
                let column = 0..self.a.nrows() / 2;
                let size: f64 = column.map(|i| square(self.vectors[(i, k)])).sum();
                let begun: f64 = (0..c.ncols()).map(|j| square(c[(k, j)])).sum();
                let left = size * begun / (1.0 / COUNTS_S + (-s.re).max(0.0));
                // Conjugate ones have as much, in as many coordinates where they do not swing.
                (k, if swings(*s) { 2.0 * left } else { left })
            })
            .collect();
        ranked.sort_by(|a, b| b.1.total_cmp(&a.1));
        let mut room = count;
        (ranked.into_iter())
            .map(|(k, _)| k)
            .filter(|k| {
                let taken = self.coordinates(*k);
                let fits = taken <= room;
                room -= if fits { taken } else { 0 };
                fits
            })
            .collect()
    }

    /// How many coordinates a motion takes: what swings has a displacement and a speed in one. What
    /// does not has its speed from its displacement; in a coordinate with another such motion it would not be
    /// separable from it, where films at several bearings are alike.
    fn coordinates(&self, k: usize) -> usize {
        let s = self.values[k];
        if swings(s) || s.im == 0.0 { 1 } else { 2 }
    }

    /// Real basis of what `kept` span, of displacements of size 1.
    pub fn span(&self, kept: &[usize]) -> Mat<f64> {
        let rows = self.a.nrows();
        let columns: Vec<Vec<f64>> = (kept.iter())
            .flat_map(|k| {
                let size = self.vectors.col(*k).subrows(0, rows / 2).norm_l2();
                let part = |of: fn(c64) -> f64| -> Vec<f64> {
                    (0..rows)
                        .map(|i| of(self.vectors[(i, *k)]) / size)
                        .collect()
                };
                let imaginary = (self.values[*k].im > 0.0).then(|| part(|u| u.im));
                [part(|u| u.re)].into_iter().chain(imaginary)
            })
            .collect();
        Mat::from_fn(rows, columns.len(), |i, j| columns[j][i])
    }

    /// `(z, z')`, two columns for each coordinate of `kept`, and the derivative of each: what `kept`
    /// span, then the displacements of what does not swing with speeds that decay as fast as the
    /// fastest of `kept` moves.
    pub fn basis(&self, kept: &[usize]) -> (Mat<f64>, Mat<f64>) {
        let (span, r) = (self.span(kept), self.a.nrows() / 2);
        let alone: Vec<usize> = (kept.iter().copied())
            .filter(|k| !swings(self.values[*k]))
            .collect();
        let (shapes, rate) = (self.span(&alone), self.fastest(kept));
        let beside = |span: &Mat<f64>, factor: f64| {
            Mat::from_fn(2 * r, span.ncols() + shapes.ncols(), |i, j| {
                match j.checked_sub(span.ncols()) {
                    None => span[(i, j)],
                    Some(j) if i < r => factor * shapes[(i, j)],
                    Some(j) => -rate * factor * shapes[(i - r, j)],
                }
            })
        };
        (beside(&span, 1.0), beside(&(&self.a * &span), -rate))
    }

    /// Largest `|s|` of `kept` [1/s].
    pub fn fastest(&self, kept: &[usize]) -> f64 {
        (kept.iter())
            .map(|k| self.values[*k].re.hypot(self.values[*k].im))
            .fold(0.0, f64::max)
    }

    /// What `kept` and their conjugates have of each column of `x`.
    pub fn part(&self, kept: &[usize], x: &Mat<f64>) -> Mat<f64> {
        let c = self.shares(x);
        Mat::from_fn(x.nrows(), x.ncols(), |i, j| {
            (kept.iter())
                .map(|k| {
                    let share = (self.vectors[(i, *k)] * c[(*k, j)]).re;
                    if self.values[*k].im > 0.0 {
                        2.0 * share
                    } else {
                        share
                    }
                })
                .sum()
        })
    }
}

/// Whether a motion swings, of each conjugate two the one with `Im s > 0`; what bearings damp more
/// is over within a turn.
fn swings(s: c64) -> bool {
    s.im > s.re.abs()
}
