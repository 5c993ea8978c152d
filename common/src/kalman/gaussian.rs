//! Holds a Gaussian estimate of a state (`Gaussian`): the mean and the upper triangle of the
//! covariance `P`, with the loads as the last states. Computes `P h` and the factors `P = U D U'`
//! for the filters, and checks that a covariance is symmetric and positive definite.

use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::kalman::unroll::{UNROLLED, unroll};

/// A Gaussian posterior over `NX` states, `x ~ N(state, P)`.
///
/// Only one triangle of the covariance exists, so that it is symmetric by
/// construction; [`crate::kalman::transition`] and [`crate::kalman`] keep it positive.
///
/// ```
/// use loadtwin_common::kalman::gaussian::Gaussian;
/// use nalgebra::{Matrix2, Vector2};
///
/// let p = Matrix2::new(4.0, 1.0, 1.0, 2.0);
/// let posterior = Gaussian::try_new(Vector2::new(0.0, 10.0), &p)?;
/// assert_eq!(posterior.covariance(), p);
/// assert_eq!(posterior.load::<1>()[0], 10.0);
/// # Ok::<(), loadtwin_common::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gaussian<const NX: usize> {
    /// Mean, `NX` x 1, in the units of the states.
    #[serde(with = "crate::matrix_serde")]
    pub state: SVector<f32, NX>,
    /// Column `j` holds `P_ij` for `i <= j`; the rest is not used.
    #[serde(with = "crate::matrix_serde")]
    pub(crate) upper: [[f32; NX]; NX],
}

impl<const NX: usize> Gaussian<NX> {
    /// Estimate with mean `state` and covariance `P` (`NX` x `NX`).
    ///
    /// # Errors
    /// `NotFinite("state")`, `NotFinite("covariance")`,
    /// `NotSymmetric("covariance")` when a pair differs by more than 1e-5 of
    /// its standard deviations, `NotPositive("covariance")` when `P` is not
    /// positive definite to working precision.
    pub fn try_new(
        state: SVector<f32, NX>,
        covariance: &SMatrix<f32, NX, NX>,
    ) -> Result<Self, Error> {
        if !state.iter().all(|x| x.is_finite()) {
            return Err(Error::NotFinite("state"));
        }
        check_symmetric(covariance.as_slice(), NX, "covariance")?;
        let p = &covariance.data.0;
        if (0..NX).any(|j| p[j][j] <= 0.0) {
            return Err(Error::NotPositive("covariance"));
        }
        if factor(p).is_none() {
            return Err(Error::NotPositive("covariance"));
        }
        Ok(Self { state, upper: *p })
    }

    /// Estimate of independent states with the given variances, [state unit]^2.
    ///
    /// # Errors
    /// As [`Gaussian::try_new`].
    pub fn independent(
        state: SVector<f32, NX>,
        variances: &SVector<f32, NX>,
    ) -> Result<Self, Error> {
        let finite = |values: &SVector<f32, NX>| values.iter().all(|value| value.is_finite());
        if !finite(&state) {
            return Err(Error::NotFinite("state"));
        }
        if !finite(variances) {
            return Err(Error::NotFinite("covariance"));
        }
        if variances.iter().any(|variance| *variance <= 0.0) {
            return Err(Error::NotPositive("covariance"));
        }
        let mut upper = [[0.0; NX]; NX];
        for (i, variance) in variances.iter().enumerate() {
            upper[i][i] = *variance;
        }
        Ok(Self { state, upper })
    }

    /// Covariance `P`, `NX` x `NX`, equal to its transpose bit for bit.
    pub fn covariance(&self) -> SMatrix<f32, NX, NX> {
        SMatrix::from_fn(|i, j| self.upper[i.max(j)][i.min(j)])
    }

    /// Variances of the states, the diagonal of `P`, `NX` x 1.
    pub fn variances(&self) -> SVector<f32, NX> {
        SVector::from_fn(|i, _| self.upper[i][i])
    }

    /// Sets the variance of a state that nothing depends on; `state < NX`.
    pub(crate) fn reset_variance(&mut self, state: usize, variance: f32) {
        if let Some(p) = self
            .upper
            .get_mut(state)
            .and_then(|column| column.get_mut(state))
        {
            *p = variance;
        }
    }

    /// Makes a state less certain by `variance`, [state unit]^2; `state < NX`.
    pub(crate) fn widen(&mut self, state: usize, variance: f32) {
        if let Some(p) = self
            .upper
            .get_mut(state)
            .and_then(|column| column.get_mut(state))
        {
            *p += variance;
        }
    }

    /// The estimated loads: the last `ND` states.
    pub fn load<const ND: usize>(&self) -> SVector<f32, ND> {
        const { assert!(ND <= NX, "there are no more loads than states") };
        let mut load = SVector::zeros();
        for i in 0..ND {
            load.data.0[0][i] = self.state.data.0[0][NX - ND + i];
        }
        load
    }

    /// Variances of the estimated loads, [load unit]^2.
    pub fn load_variances<const ND: usize>(&self) -> SVector<f32, ND> {
        const { assert!(ND <= NX, "there are no more loads than states") };
        SVector::from_fn(|i, _| self.upper[NX - ND + i][NX - ND + i])
    }
}

/// `P h` from the upper triangle of `P`, and the part `sum P_ii h_i^2` of
/// `h' P h`.
#[inline(always)]
#[expect(
    clippy::inline_always,
    reason = "the matrix stays in registers from row to row"
)]
pub(crate) fn symmetric_product<const NX: usize>(
    upper: &[[f32; NX]; NX],
    h: &[f32; NX],
) -> ([f32; NX], f32) {
    let mut w = [0.0; NX];
    let mut diagonal = 0.0;
    for j in 0..NX {
        w[j] = upper[j][j] * h[j];
        diagonal += w[j] * h[j];
    }
    if NX <= UNROLLED {
        unroll!(j in 0..NX {
            let mut w_j = w[j];
            for i in 0..j {
                w_j += upper[j][i] * h[i];
                w[i] += upper[j][i] * h[j];
            }
            w[j] = w_j;
        });
        return (w, diagonal);
    }
    // Two columns at a time: half the loads of `w` and `h`.
    let mut j = 0;
    while j + 1 < NX {
        let (h0, h1) = (h[j], h[j + 1]);
        let corner = upper[j + 1][j];
        let (mut w0, mut w1) = (w[j] + corner * h1, w[j + 1] + corner * h0);
        let columns = upper[j].iter().zip(&upper[j + 1]);
        for ((w, h), (u0, u1)) in w.iter_mut().zip(h).zip(columns).take(j) {
            w0 += u0 * h;
            w1 += u1 * h;
            *w += u0 * h0 + u1 * h1;
        }
        w[j] = w0;
        w[j + 1] = w1;
        j += 2;
    }
    if j < NX {
        let mut last = w[j];
        for ((w, h_i), u) in w.iter_mut().zip(h).zip(&upper[j]).take(j) {
            last += u * h_i;
            *w += u * h[j];
        }
        w[j] = last;
    }
    (w, diagonal)
}

/// Checks that a covariance, `n` columns of `n` entries, is finite and equal to its
/// transpose.
///
/// One copy for all numbers of states: it runs once, and flash is short.
#[inline(never)]
pub(crate) fn check_symmetric(columns: &[f32], n: usize, name: &'static str) -> Result<(), Error> {
    if !columns.iter().all(|p| p.is_finite()) {
        return Err(Error::NotFinite(name));
    }
    let p = |i: usize, j: usize| columns.get(j * n + i).copied().unwrap_or(f32::NAN);
    for j in 0..n {
        for i in 0..j {
            let scale = libm::sqrtf(p(i, i).abs()) * libm::sqrtf(p(j, j).abs());
            if (p(i, j) - p(j, i)).abs() > 1e-5 * scale {
                return Err(Error::NotSymmetric(name));
            }
        }
    }
    Ok(())
}

/// Factors `P = U D U'`, `U` unit upper triangular (column `j` holds `U_ij`
/// for `i < j`), `D` on the diagonal, from the upper triangle of `P`.
///
/// `D_j = P_jj - sum_{m>j} U_jm^2 D_m`,
/// `U_ij = (P_ij - sum_{m>j} U_im D_m U_jm) / D_j`
///
/// None when a `D_j` is not positive beyond rounding.
pub(crate) fn factor<const NX: usize>(upper: &[[f32; NX]; NX]) -> Option<[[f32; NX]; NX]> {
    let mut u = *upper;
    for j in (0..NX).rev() {
        let floor = u[j][j] * 1e-7;
        for m in j + 1..NX {
            let g = u[m][j] * u[m][m];
            for i in 0..=j {
                u[j][i] -= u[m][i] * g;
            }
        }
        if u[j][j] <= floor || u[j][j].is_nan() {
            return None;
        }
        let inverse = 1.0 / u[j][j];
        for i in 0..j {
            u[j][i] *= inverse;
        }
    }
    Some(u)
}
