//! What a filter believes: a mean and a covariance kept as factors.

use nalgebra::{SMatrix, SVector};

use crate::error::Error;

/// Lowest variance that a belief or a channel may have, [unit]^2.
///
/// With [`MAX_VARIANCE`] it keeps every product of the factored update inside
/// the range of f32.
pub const MIN_VARIANCE: f32 = 1e-24;

/// Highest variance that a channel's innovation may have, [unit]^2.
pub const MAX_VARIANCE: f32 = 1e24;

/// Share of a variance that its last few roundings may have made up. A
/// conditional variance below it is rounding noise and is raised to it.
const ROUNDING: f32 = 1.0 / (1u32 << 22) as f32;

/// A Gaussian belief over `NX` states, `x ~ N(state, P)`.
///
/// `P = U D U'`, `U` unit upper triangular, `D` diagonal and positive.
///
/// The covariance is not stored; its factors are. That makes it symmetric and
/// positive definite whatever the rounding, gives the unscented filter its
/// matrix square root for nothing, and costs no more instructions than one
/// triangle of `P`, so that the condition number that f32 can carry is that
/// of `U D^(1/2)`, the square root of that of `P`.
///
/// Source: Bierman, Factorization Methods for Discrete Sequential
/// Estimation, 1977, ch. III and V.
///
/// ```
/// use loadtwin_common::gaussian::Gaussian;
/// use nalgebra::{Matrix2, Vector2};
///
/// let p = Matrix2::new(4.0, 1.0, 1.0, 2.0);
/// let belief = Gaussian::try_new(Vector2::new(0.0, 10.0), &p)?;
/// assert_eq!(belief.covariance(), p);
/// assert_eq!(belief.load::<1>()[0], 10.0);
/// # Ok::<(), loadtwin_common::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gaussian<const NX: usize> {
    /// Mean, `NX` x 1, in the units of the states.
    pub state: SVector<f32, NX>,
    /// Column `j` holds `U_ij` for `i < j`, `D_j` at `i = j`; the rest is not used.
    pub(crate) factor: [[f32; NX]; NX],
}

impl<const NX: usize> Gaussian<NX> {
    /// Belief with mean `state` and covariance `P` (`NX` x `NX`).
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
        check_symmetric(covariance, "covariance")?;
        let p = &covariance.data.0;
        if (0..NX).any(|j| p[j][j] < MIN_VARIANCE) {
            return Err(Error::NotPositive("covariance"));
        }
        let mut belief = Self { state, factor: *p };
        if belief.refactor() < NX {
            return Err(Error::NotPositive("covariance"));
        }
        Ok(belief)
    }

    /// Belief in independent states with the given variances, [state unit]^2.
    ///
    /// # Errors
    /// As [`Gaussian::try_new`].
    pub fn independent(
        state: SVector<f32, NX>,
        variances: &SVector<f32, NX>,
    ) -> Result<Self, Error> {
        Self::try_new(state, &SMatrix::from_diagonal(variances))
    }

    /// Covariance `P = U D U'`, `NX` x `NX`, equal to its transpose bit for bit.
    pub fn covariance(&self) -> SMatrix<f32, NX, NX> {
        let mut p = SMatrix::zeros();
        for j in 0..NX {
            for i in 0..=j {
                let p_ij = self.covariance_of(i, j);
                p.data.0[j][i] = p_ij;
                p.data.0[i][j] = p_ij;
            }
        }
        p
    }

    /// `P_ij` for `i <= j`.
    fn covariance_of(&self, i: usize, j: usize) -> f32 {
        let u = &self.factor;
        let mut sum = if i == j { u[j][j] } else { u[j][i] * u[j][j] };
        for k in j + 1..NX {
            sum += u[k][i] * u[k][j] * u[k][k];
        }
        sum
    }

    /// Variances of the states, the diagonal of `P`, `NX` x 1.
    pub fn variances(&self) -> SVector<f32, NX> {
        let mut variances = SVector::zeros();
        for i in 0..NX {
            variances.data.0[0][i] = self.covariance_of(i, i);
        }
        variances
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

    /// Variances of the estimated loads, [load unit]^2; cheap, since the loads
    /// are the last states.
    pub fn load_variances<const ND: usize>(&self) -> SVector<f32, ND> {
        const { assert!(ND <= NX, "there are no more loads than states") };
        let mut variances = SVector::zeros();
        for i in 0..ND {
            variances.data.0[0][i] = self.covariance_of(NX - ND + i, NX - ND + i);
        }
        variances
    }

    /// Replaces the upper triangle of `P` in `factor` by its factors `U`, `D`.
    ///
    /// From the last column to the first:
    /// `D_j = P_jj - sum_{m>j} U_jm^2 D_m`,
    /// `U_ij = (P_ij - sum_{m>j} U_im D_m U_jm) / D_j`.
    /// A `D_j` that drowns in rounding is raised to its rounding; returns how
    /// many were not. Backward stable: the factors are those of a matrix
    /// within a few roundings of `P`.
    pub(crate) fn refactor(&mut self) -> usize {
        let u = &mut self.factor;
        let mut sound = 0;
        for j in (0..NX).rev() {
            let mut column = u[j];
            let floor = column[j] * ROUNDING + MIN_VARIANCE;
            for m in j + 1..NX {
                let g = u[m][j] * u[m][m];
                for i in 0..=j {
                    column[i] -= u[m][i] * g;
                }
            }
            if column[j] > floor {
                sound += 1;
            } else {
                column[j] = floor;
            }
            let inverse = 1.0 / column[j];
            for i in 0..j {
                column[i] *= inverse;
            }
            u[j] = column;
        }
        sound
    }
}

/// Checks that a covariance is finite and equal to its transpose.
pub(crate) fn check_symmetric<const NX: usize>(
    covariance: &SMatrix<f32, NX, NX>,
    name: &'static str,
) -> Result<(), Error> {
    if !covariance.iter().all(|p| p.is_finite()) {
        return Err(Error::NotFinite(name));
    }
    let p = &covariance.data.0;
    for j in 0..NX {
        for i in 0..j {
            let scale = libm::sqrtf(p[i][i].abs()) * libm::sqrtf(p[j][j].abs());
            if (p[j][i] - p[i][j]).abs() > 1e-5 * scale {
                return Err(Error::NotSymmetric(name));
            }
        }
    }
    Ok(())
}
