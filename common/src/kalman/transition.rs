//! Advances state and covariance of an augmented Kalman filter by one sample (`Transition`,
//! `ProcessNoise`): `x+ = [A B; 0 F_d] x`, `P+ = F P F' + Q`. The load model `F_d` is a random
//! walk, a Gauss-Markov process or rotating phasors.
#![expect(
    clippy::range_plus_one,
    reason = "an inclusive range carries a flag that keeps its loop from being unrolled"
)]

use nalgebra::{SMatrix, SVector};

use crate::error::Error;
use crate::kalman::gaussian::{Gaussian, check_symmetric, symmetric_product};
use crate::kalman::unroll::unroll;

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
pub struct GaussMarkov<const ND: usize> {
    factor: [f32; ND],
}

impl<const ND: usize> GaussMarkov<ND> {
    /// Decay with time constants `tau_s` (s) at a sample period `dt_s` (s).
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

impl<const ND: usize> LoadModel<ND> for GaussMarkov<ND> {
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
pub struct Harmonic {
    cosine: f32,
    sine: f32,
}

impl Harmonic {
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

impl<const ND: usize> LoadModel<ND> for Harmonic {
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

/// Relative inflation of every variance in each prediction.
///
/// The roundings of one step, some tens of 2^-24, could otherwise turn the
/// covariance indefinite where the process noise is smaller than they are.
pub(crate) const INFLATION: f32 = 1.0 / (1u32 << 20) as f32;

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
    /// States without the loads.
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

    /// As [`Transition::try_new`], from the `NX - ND` rows of `[A B]`, one after the other.
    ///
    /// # Errors
    /// `NotFinite("transition")`; `OutOfRange("transition")` where there are fewer or more.
    pub fn from_rows(entries: &[f32], load_model: L) -> Result<Self, Error> {
        if entries.len() != NX * Self::NA {
            return Err(Error::OutOfRange("transition"));
        }
        if !entries.iter().all(|f| f.is_finite()) {
            return Err(Error::NotFinite("transition"));
        }
        let mut rows = [[0.0; NX]; NX];
        for (slot, entry) in rows.as_flattened_mut().iter_mut().zip(entries) {
            *slot = *entry;
        }
        Ok(Self { rows, load_model })
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
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "a call saves and restores what the rows are summed in: 12 instructions"
    )]
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

    /// `P <- F P F' + Q` on one triangle.
    ///
    /// `M = [A B] P`, then `P_xx = M [A B]' + Q`, `P_xd = M_d F_d'`,
    /// `P_dd = F_d P_dd F_d' + Q_d`, where `M_d` are the last `ND` columns of
    /// `M`. The diagonal is inflated by [`INFLATION`].
    #[inline]
    pub(crate) fn propagate_covariance(
        &self,
        posterior: &mut Gaussian<NX>,
        noise: &ProcessNoise<NX>,
    ) {
        let p = &mut posterior.upper;
        let mut m = [[0.0; NX]; NX];
        for i in 0..Self::NA {
            (m[i], _) = symmetric_product(p, &self.rows[i]);
        }
        let mut p_dd = [[0.0; ND]; ND];
        for j in 0..ND {
            for i in 0..ND {
                p_dd[j][i] = p[Self::NA + i.max(j)][Self::NA + i.min(j)];
            }
            self.load_model.advance(&mut p_dd[j]);
        }
        for i in 0..ND {
            let mut row = [0.0; ND];
            for j in 0..ND {
                row[j] = p_dd[j][i];
            }
            self.load_model.advance(&mut row);
            for j in i..ND {
                p[Self::NA + j][Self::NA + i] = row[j] + noise.columns[Self::NA + j][Self::NA + i];
            }
        }
        for i in 0..Self::NA {
            let mut row = [0.0; ND];
            for (r, m) in row.iter_mut().zip(&m[i][Self::NA..]) {
                *r = *m;
            }
            self.load_model.advance(&mut row);
            for j in 0..ND {
                p[Self::NA + j][i] = row[j] + noise.columns[Self::NA + j][i];
            }
        }
        unroll!(j in 0..NX {
            if j < Self::NA {
                for i in 0..j + 1 {
                    let mut sum = noise.columns[j][i];
                    for k in 0..NX {
                        sum += m[i][k] * self.rows[j][k];
                    }
                    p[j][i] = sum;
                }
                p[j][j] += p[j][j] * INFLATION;
            }
        });
        for j in Self::NA..NX {
            p[j][j] += p[j][j] * INFLATION;
        }
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
        check_noise(covariance.as_slice(), NX)?;
        Ok(Self {
            columns: covariance.data.0,
        })
    }

    /// Independent noise on each state, variances per sample, [state unit]^2.
    ///
    /// # Errors
    /// As [`ProcessNoise::try_new`].
    pub fn independent(variances: &SVector<f32, NX>) -> Result<Self, Error> {
        Self::try_new(&SMatrix::from_diagonal(variances))
    }
}

/// One copy for all numbers of states, as [`check_symmetric`].
#[inline(never)]
fn check_noise(columns: &[f32], n: usize) -> Result<(), Error> {
    check_symmetric(columns, n, "process_noise")?;
    let q = |i: usize, j: usize| columns.get(j * n + i).copied().unwrap_or(f32::NAN);
    for j in 0..n {
        for i in 0..j + 1 {
            let bound = q(i, i) * q(j, j) * 1.000_01;
            if q(j, j) < 0.0 || q(i, j) * q(i, j) > bound {
                return Err(Error::NotPositive("process_noise"));
            }
        }
    }
    Ok(())
}
