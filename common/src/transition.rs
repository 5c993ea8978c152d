//! From one sample to the next: the augmented transition and its noise.

use nalgebra::{SMatrix, SVector};

use crate::error::Error;
use crate::gaussian::{Gaussian, check_symmetric};

/// How the loads evolve between samples when nothing is measured, `d+ = F_d d`.
///
/// Source: Bosmans et al. 2023, eq. (7); there the identity.
pub trait LoadModel<const ND: usize> {
    /// Advances a vector of loads, or any vector over the loads, by one
    /// sample: `d <- F_d d`. Must be linear.
    fn advance(&self, load: &mut [f32; ND]);
}

/// Loads stay what they are, `F_d = I`: the right model when nothing is known.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RandomWalk;

impl<const ND: usize> LoadModel<ND> for RandomWalk {
    #[inline]
    fn advance(&self, _: &mut [f32; ND]) {}
}

/// Loads die out, each at its own rate: `d_i+ = exp(-dt / tau_i) d_i`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Decay<const ND: usize> {
    factor: [f32; ND],
}

impl<const ND: usize> Decay<ND> {
    /// Decay with time constants `tau_s` [s] at a sample period `dt_s` [s].
    ///
    /// # Errors
    /// `NotPositive("time_constant")`, `NotPositive("dt")`.
    pub fn try_new(tau_s: [f32; ND], dt_s: f32) -> Result<Self, Error> {
        if !(dt_s > 0.0 && dt_s.is_finite()) {
            return Err(Error::NotPositive("dt"));
        }
        let mut factor = tau_s;
        for f in &mut factor {
            if f.is_nan() || *f <= 0.0 {
                return Err(Error::NotPositive("time_constant"));
            }
            *f = libm::expf(-dt_s / *f);
        }
        Ok(Self { factor })
    }
}

impl<const ND: usize> LoadModel<ND> for Decay<ND> {
    #[inline]
    fn advance(&self, load: &mut [f32; ND]) {
        for i in 0..ND {
            load[i] *= self.factor[i];
        }
    }
}

/// Loads are phasors that turn with a shaft, in pairs `(d_x, d_y)`:
/// `d_x+ = c d_x - s d_y`, `d_y+ = s d_x + c d_y`.
///
/// The forces of an unbalance at speed `omega` turn by `omega dt` each sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rotation {
    cosine: f32,
    sine: f32,
}

impl Rotation {
    /// Turns by `angle_rad` each sample, positive from x to y.
    ///
    /// # Errors
    /// `NotFinite("angle")`.
    pub fn try_new(angle_rad: f32) -> Result<Self, Error> {
        if angle_rad.is_finite() {
            Ok(Self {
                cosine: libm::cosf(angle_rad),
                sine: libm::sinf(angle_rad),
            })
        } else {
            Err(Error::NotFinite("angle"))
        }
    }
}

impl<const ND: usize> LoadModel<ND> for Rotation {
    #[inline]
    fn advance(&self, load: &mut [f32; ND]) {
        const { assert!(ND.is_multiple_of(2), "phasors come in pairs") };
        for pair in load.chunks_exact_mut(2) {
            if let [x, y] = pair {
                (*x, *y) = (
                    self.cosine * *x - self.sine * *y,
                    self.sine * *x + self.cosine * *y,
                );
            }
        }
    }
}

/// Augmented transition `x+ = [A B; 0 F_d] x`; the last `ND` of the `NX`
/// states are the loads.
///
/// `A`: (NX-ND) x (NX-ND), `B`: (NX-ND) x ND, both discretised for the sample
/// period; `F_d`: ND x ND, the [`LoadModel`]. The zero block is never computed.
/// A known input is added to [`Gaussian::state`] by the caller.
///
/// Source: Bosmans et al. 2023, eq. (6), (8).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transition<const NX: usize, const ND: usize, L = RandomWalk> {
    /// Rows of `[A B]`; the last `ND` are not used.
    rows: [[f32; NX]; NX],
    /// `F_d`.
    load_model: L,
}

impl<const NX: usize, const ND: usize, L: LoadModel<ND>> Transition<NX, ND, L> {
    const NA: usize = NX - ND;

    /// Takes the upper NX-ND rows of `matrix`, `[A B]`; the lower ones are
    /// given by the load model and must be zero in the columns of the states.
    ///
    /// # Errors
    /// `NotFinite("transition")`; `OutOfRange("transition")` when a load
    /// depends on a state.
    pub fn try_new(matrix: &SMatrix<f32, NX, NX>, load_model: L) -> Result<Self, Error> {
        if !matrix.iter().all(|f| f.is_finite()) {
            return Err(Error::NotFinite("transition"));
        }
        if (0..Self::NA).any(|j| (Self::NA..NX).any(|i| matrix.data.0[j][i] != 0.0)) {
            return Err(Error::OutOfRange("transition"));
        }
        Ok(Self::new(matrix, load_model))
    }

    /// As [`Transition::try_new`] without its checks, for Jacobians made in a
    /// step; the lower `ND` rows are ignored.
    #[inline]
    pub fn new(matrix: &SMatrix<f32, NX, NX>, load_model: L) -> Self {
        Self {
            rows: matrix.transpose().data.0,
            load_model,
        }
    }

    /// The load model, for those that change from sample to sample.
    pub fn load_model_mut(&mut self) -> &mut L {
        &mut self.load_model
    }

    /// Whether every number of `[A B]` is finite.
    pub(crate) fn is_finite(&self) -> bool {
        self.rows
            .iter()
            .take(Self::NA)
            .flatten()
            .all(|f| f.is_finite())
    }

    /// `[A B; 0 F_d] x`.
    #[inline]
    pub fn propagate(&self, state: &SVector<f32, NX>) -> SVector<f32, NX> {
        let x = &state.data.0[0];
        let mut next = SVector::<f32, NX>::zeros();
        for i in 0..Self::NA {
            let mut sum = self.rows[i][0] * x[0];
            for k in 1..NX {
                sum += self.rows[i][k] * x[k];
            }
            next.data.0[0][i] = sum;
        }
        let mut load = [0.0; ND];
        for (d, x) in load.iter_mut().zip(&x[Self::NA..]) {
            *d = *x;
        }
        self.load_model.advance(&mut load);
        for (x, d) in next.data.0[0][Self::NA..].iter_mut().zip(&load) {
            *x = *d;
        }
        next
    }

    /// `P <- F P F' + Q` on the factors of `P`.
    ///
    /// `W = F U` row by row, then the columns of `W D W' + Q`, then its factors.
    #[inline]
    pub(crate) fn propagate_covariance(&self, belief: &mut Gaussian<NX>, noise: &ProcessNoise<NX>) {
        let u = &belief.factor;
        let mut w = [[0.0; NX]; NX];
        let mut d = [0.0; NX];
        for j in 0..NX {
            d[j] = u[j][j];
            for i in 0..Self::NA {
                let mut sum = self.rows[i][j];
                for k in 0..j {
                    sum += self.rows[i][k] * u[j][k];
                }
                w[i][j] = sum;
            }
        }
        for j in Self::NA..NX {
            let mut column = [0.0; ND];
            for (c, u) in column.iter_mut().zip(&u[j][Self::NA..j]) {
                *c = *u;
            }
            column[j - Self::NA] = 1.0;
            self.load_model.advance(&mut column);
            for i in Self::NA..NX {
                w[i][j] = column[i - Self::NA];
            }
        }
        for j in 0..NX {
            // A load has no share in the first NX-ND columns of U.
            let first = if j < Self::NA { 0 } else { Self::NA };
            let mut wd = [0.0; NX];
            for k in first..NX {
                wd[k] = w[j][k] * d[k];
            }
            for i in 0..=j {
                let mut sum = noise.columns[j][i];
                for k in first..NX {
                    sum += w[i][k] * wd[k];
                }
                belief.factor[j][i] = sum;
            }
        }
        belief.refactor();
    }
}

/// Process noise `[Q 0; 0 Q_d]` per sample; any symmetric matrix is taken.
///
/// Source: Bosmans et al. 2023, eq. (8), where `Q_d` is diagonal.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ProcessNoise<const NX: usize> {
    /// Columns; the upper triangle is used.
    pub(crate) columns: [[f32; NX]; NX],
}

impl<const NX: usize> ProcessNoise<NX> {
    /// Process noise covariance per sample, `NX` x `NX`, symmetric, positive
    /// semidefinite.
    ///
    /// # Errors
    /// `NotFinite("process_noise")`, `NotSymmetric("process_noise")`,
    /// `NotPositive("process_noise")` when a variance is negative or a
    /// correlation is above 1.
    pub fn try_new(covariance: &SMatrix<f32, NX, NX>) -> Result<Self, Error> {
        check_symmetric(covariance, "process_noise")?;
        let columns = covariance.data.0;
        for j in 0..NX {
            for i in 0..=j {
                let bound = columns[i][i] * columns[j][j] * 1.000_01;
                if columns[j][j] < 0.0 || columns[j][i] * columns[j][i] > bound {
                    return Err(Error::NotPositive("process_noise"));
                }
            }
        }
        Ok(Self { columns })
    }

    /// Independent noise on each state, variances per sample, [state unit]^2.
    ///
    /// # Errors
    /// As [`ProcessNoise::try_new`].
    pub fn independent(variances: &SVector<f32, NX>) -> Result<Self, Error> {
        Self::try_new(&SMatrix::from_diagonal(variances))
    }
}
