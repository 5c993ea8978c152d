//! Eigenpairs of the rotor, and those that motion after a start is made of.

use faer::linalg::solvers::{PartialPivLu, Solve};
use faer::{Mat, c64};

use super::RotorError;
use super::model::RotorModel;
use super::reduction::Reduced;

/// Time after which free motion counts less: undamped motion has no end [s].
const COUNTS_S: f64 = 10.0;

/// Eigenpairs of `x' = A x`, `x = (z, z')`, `A u = s u`, at one speed.
pub(super) struct Eigenpairs {
    a: Mat<f64>,
    values: Vec<c64>,
    vectors: Mat<c64>,
    factor: PartialPivLu<c64>,
    /// Those that swing, `Im s > |Re s|`, one of each two. What bearings damp more is over
    /// within a turn, and has no second motion that its speed could be told from.
    swinging: Vec<usize>,
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
            swinging: (0..2 * r)
                .filter(|k| values[*k].im > values[*k].re.abs())
                .collect(),
            values,
            factor: vectors.partial_piv_lu(),
            vectors,
            a,
        })
    }

    /// How many there are to choose from.
    pub fn len(&self) -> usize {
        self.swinging.len()
    }

    /// `c` of `x = sum_k c_k u_k`, for each column of `x`.
    fn shares(&self, x: &Mat<f64>) -> Mat<c64> {
        self.factor
            .solve(Mat::from_fn(x.nrows(), x.ncols(), |i, j| {
                c64::new(x[(i, j)], 0.0)
            }))
    }

    /// The `count` that have most of what follows `starts`, a column each.
    ///
    /// `|c_k|^2 |z_k|^2 / (1 / 10 s - Re s_k)`, summed over the starts: the square of the
    /// displacement over the time that it lasts.
    pub fn leading(&self, starts: &Mat<f64>, count: usize) -> Vec<usize> {
        let c = self.shares(starts);
        let square = |z: c64| z.re * z.re + z.im * z.im;
        let mut ranked: Vec<(usize, f64)> = (self.swinging.iter())
            .map(|k| {
                let column = 0..self.a.nrows() / 2;
                let size: f64 = column.map(|i| square(self.vectors[(i, *k)])).sum();
                let begun: f64 = (0..c.ncols()).map(|j| square(c[(*k, j)])).sum();
                let decay = (-self.values[*k].re).max(0.0);
                (*k, size * begun / (1.0 / COUNTS_S + decay))
            })
            .collect();
        ranked.sort_by(|a, b| b.1.total_cmp(&a.1));
        ranked.into_iter().take(count).map(|(k, _)| k).collect()
    }

    /// Real basis of what `kept` span, two columns for each, of displacements of size 1.
    pub fn basis(&self, kept: &[usize]) -> Mat<f64> {
        let rows = self.a.nrows();
        let sizes: Vec<f64> = (kept.iter())
            .map(|k| self.vectors.col(*k).subrows(0, rows / 2).norm_l2())
            .collect();
        Mat::from_fn(rows, 2 * kept.len(), |i, j| {
            let value = self.vectors[(i, kept[j / 2])];
            (if j % 2 == 0 { value.re } else { value.im }) / sizes[j / 2]
        })
    }

    /// What `kept` and their conjugates have of each column of `x`.
    pub fn part(&self, kept: &[usize], x: &Mat<f64>) -> Mat<f64> {
        let c = self.shares(x);
        Mat::from_fn(x.nrows(), x.ncols(), |i, j| {
            (kept.iter())
                .map(|k| 2.0 * (self.vectors[(i, *k)] * c[(*k, j)]).re)
                .sum()
        })
    }

    /// `A x`.
    pub fn derivative(&self, x: &Mat<f64>) -> Mat<f64> {
        &self.a * x
    }
}
