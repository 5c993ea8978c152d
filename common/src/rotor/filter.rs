//! Predicts and updates the augmented Kalman filter of a reduced rotor in `f32` or `f64` (`Real`):
//! mean and covariance of modal displacements, their changes, forces and sensor biases by one
//! sample, then an update by one displacement sensor after the other.
//!
//! States: modal displacements `z` (NZ), their change to the next sample `e`
//! (NZ), forces `f` in pairs (x, y) that drive them ([`FORCES`]), and what is left, the
//! biases `b` of sensors (NX - 2 NZ - [`FORCES`]).
//!
//! `z+ = z + e`, `e+ = e + D (z, e, f)`, `s+ = R s` with `s = (f, b)`; a sensor reads `h z + b`
//!
//! Any discretised second-order system takes this form (with
//! `e = (A_11 - I) z + A_12 z' + B_1 f`), and of its transition only `D` is dense:
//! the prediction of `P` takes less than half of what it takes with (z, z'). `D` is what
//! changes, not what stays: damping is some 1e-4 in a sample, of which f32 has all digits,
//! and beside a 1 only three. So it is with the turn of forces ([`LoadTransition`]).
//!
//! Source: Rezende et al. 2023, eq. (7), (10)-(12); Middleton and Goodwin, IEEE Trans. Autom.
//! Control 31 (1986), for changes in place of values.
#![expect(
    clippy::range_plus_one,
    reason = "an inclusive range carries a flag that keeps its loop from being unrolled"
)]

use core::ops::{Add, AddAssign, Div, Mul, Neg, Sub, SubAssign};

use serde::{Deserialize, Serialize};

use crate::matrix_serde::Flat;

/// States that are forces, two for each load.
pub const FORCES: usize = 4;

/// Most biases that a filter has states for.
pub const BIASES: usize = 4;

/// Rows of `D` that are multiplied at once: as many as share a loaded column.
const ROWS: usize = 4;

/// A floating-point number: `f32` in the estimator, `f64` where its accuracy is evaluated.
pub trait Real:
    Copy
    + PartialOrd
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
{
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;
    /// Relative inflation of every variance in each prediction, one rounding: without, variances
    /// become negative; each more is noise of the model that is not there.
    const INFLATION: Self;
    /// Share of a channel's prior variance below which its noise is not resolved.
    const RESOLUTION: Self;
    /// Largest finite number.
    const MAX: Self;
}

impl Real for f32 {
    const ZERO: Self = 0.0;
    const ONE: Self = 1.0;
    const INFLATION: Self = 1.0 / (1u32 << 24) as f32;
    const RESOLUTION: Self = 1.0 / (1u32 << 18) as f32;
    const MAX: Self = f32::MAX;
}

impl Real for f64 {
    const ZERO: Self = 0.0;
    const ONE: Self = 1.0;
    const INFLATION: Self = 0.0;
    const RESOLUTION: Self = 0.0;
    const MAX: Self = f64::MAX;
}

/// Mean and covariance of the states, both triangles alike.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(bound = "[T; NX]: Flat, [[T; NX]; NX]: Flat")]
pub struct StateEstimate<T, const NX: usize> {
    /// `x`.
    #[serde(with = "crate::matrix_serde")]
    pub state: [T; NX],
    /// `P`.
    #[serde(with = "crate::matrix_serde")]
    pub covariance: [[T; NX]; NX],
}

/// How a sensor reads the state: `y = h z + b`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ObservationRow<T, const NZ: usize> {
    /// `h`, over the modal displacements.
    pub modal: [T; NZ],
    /// The state that is its bias, in the unit of its reading.
    pub bias: Option<usize>,
}

impl<T, const NZ: usize> ObservationRow<T, NZ> {
    /// Its bias among NX states; none in a filter without.
    fn bias<const NX: usize>(&self) -> Option<usize> {
        if NX > 2 * NZ + FORCES {
            self.bias.filter(|bias| *bias < NX)
        } else {
            None
        }
    }
}

/// Transition of forces and biases in one sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoadTransition<T> {
    /// Bit k: pair k turns with the shaft and grows with its speed squared.
    pub synchronous_mask: u8,
    /// Pairs of forces.
    pub pairs: usize,
    /// What a pair gains along itself: `g cos(a) - 1`, of the shaft's angle `a` in the sample
    /// and the growth `g`.
    pub cos_minus_one: T,
    /// And across: `g sin(a)`.
    pub sin: T,
    /// Part of each bias that is left after the sample.
    pub bias_decay: [T; BIASES],
}

impl<T: Real> LoadTransition<T> {
    /// `R s`, in place.
    fn apply(&self, s: &mut [T]) {
        for (k, pair) in s.chunks_exact_mut(2).take(FORCES / 2).enumerate() {
            if let ([x, y], true) = (pair, self.synchronous_mask & (1 << k) != 0) {
                (*x, *y) = (
                    *x + (self.cos_minus_one * *x - self.sin * *y),
                    *y + (self.sin * *x + self.cos_minus_one * *y),
                );
            }
        }
        for (bias, bias_decay) in s.iter_mut().skip(FORCES).zip(&self.bias_decay) {
            *bias = *bias_decay * *bias;
        }
    }
}

/// Innovation of one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Innovation<T> {
    /// `nu`.
    pub innovation: T,
    /// `s`.
    pub variance: T,
    /// `nu^2 / s`.
    pub nis: T,
}

/// The mean one sample on.
// Inlined into a whole step, it takes 200 instructions more.
#[inline(never)]
pub fn predict_state<T: Real, const NZ: usize, const NX: usize>(
    state: &mut [T; NX],
    increment_matrix: &[[T; NX]; NZ],
    turn: &LoadTransition<T>,
) {
    let mut change = [T::ZERO; NZ];
    for i in 0..NZ {
        let mut sum = increment_matrix[i][0] * state[0];
        for k in 1..2 * NZ + FORCES {
            sum += increment_matrix[i][k] * state[k];
        }
        change[i] = sum;
    }
    for i in 0..NZ {
        let step = state[NZ + i];
        state[i] += step;
        state[NZ + i] = step + change[i];
    }
    turn.apply(&mut state[2 * NZ..]);
}

/// The covariance one sample on, `P <- F P F' + Q`.
///
/// `W = P_e + D P`; then `P_zz` gets `P_ze + P_ez + P_ee`, `P_ez = W_z + W_e`, `P_ee =
/// W_e + W D'`, `P_es = W_s R'`, `P_zs <- (P_zs + P_es) R'`, `P_ss <- R P_ss R'`.
///
/// `noise`: lower triangle of `Q`, row by row.
#[inline(never)]
pub fn predict_covariance<T: Real, const NZ: usize, const NX: usize>(
    p: &mut [[T; NX]; NX],
    increment_matrix: &[[T; NX]; NZ],
    turn: &LoadTransition<T>,
    noise: impl Fn(usize) -> T,
) {
    const {
        assert!(
            NZ.is_multiple_of(ROWS) && 2 * NZ + FORCES <= NX && NX <= 2 * NZ + FORCES + BIASES,
            "states of a rotor"
        );
    };
    let mut w = [[T::ZERO; NX]; NZ];
    for i in (0..NZ).step_by(ROWS) {
        for j in 0..NX {
            let e = NZ + i;
            let (mut a, mut b, mut c, mut d) = (p[j][e], p[j][e + 1], p[j][e + 2], p[j][e + 3]);
            for k in 0..2 * NZ + FORCES {
                let column = p[j][k];
                a += increment_matrix[i][k] * column;
                b += increment_matrix[i + 1][k] * column;
                c += increment_matrix[i + 2][k] * column;
                d += increment_matrix[i + 3][k] * column;
            }
            (w[i][j], w[i + 1][j], w[i + 2][j], w[i + 3][j]) = (a, b, c, d);
        }
    }
    for i in 0..NZ {
        for j in 0..i + 1 {
            p[i][j] += p[i][NZ + j] + p[NZ + i][j] + p[NZ + i][NZ + j];
        }
        let mut row = [T::ZERO; NX];
        for j in 2 * NZ..NX {
            row[j] = p[i][j] + p[NZ + i][j];
        }
        turn.apply(&mut row[2 * NZ..]);
        for j in 2 * NZ..NX {
            p[j][i] = row[j];
        }
    }
    for j in 2 * NZ..NX {
        turn.apply(&mut p[j][2 * NZ..]);
    }
    for j in 2 * NZ..NX {
        let mut column = [T::ZERO; NX];
        for i in 2 * NZ..NX {
            column[i] = p[i][j];
        }
        turn.apply(&mut column[2 * NZ..]);
        for i in 2 * NZ..NX {
            p[i][j] = column[i];
        }
    }
    for i in 0..NZ {
        for j in 0..i + 1 {
            let mut sum = w[i][NZ + j];
            for k in 0..2 * NZ + FORCES {
                sum += w[i][k] * increment_matrix[j][k];
            }
            p[NZ + i][NZ + j] = sum;
        }
        for j in 0..NZ {
            p[NZ + i][j] = w[i][j] + w[i][NZ + j];
        }
    }
    for i in 0..NZ {
        turn.apply(&mut w[i][2 * NZ..]);
    }
    for i in 0..NZ {
        for j in 2 * NZ..NX {
            p[j][NZ + i] = w[i][j];
        }
    }
    let mut entry = 0;
    for i in 0..NX {
        for j in 0..i + 1 {
            let value = p[i][j] + noise(entry);
            p[i][j] = value;
            p[j][i] = value;
            entry += 1;
        }
        let inflation = p[i][i] * T::INFLATION;
        p[i][i] += inflation;
    }
}

/// `h z + b`.
pub fn predict_measurement<T: Real, const NZ: usize, const NX: usize>(
    state: &[T; NX],
    row: &ObservationRow<T, NZ>,
) -> T {
    let mut sum = row.modal[0] * state[0];
    for i in 1..NZ {
        sum += row.modal[i] * state[i];
    }
    if let Some(bias) = row.bias::<NX>() {
        sum += state[bias];
    }
    sum
}

/// Measurement update by one scalar channel `y = h z + b + v`.
///
/// `s = h P h' + r`, `k = P h' / s`, `x+ = x + k nu`, `P+ = P - k s k'`
///
/// `admits` decides by the NIS; where it refuses, or a number is not finite, the
/// posterior is untouched and the second value false.
///
/// Source: Rezende et al. 2023, figure 1, one row at a time.
#[inline(never)]
pub fn update<T: Real, const NZ: usize, const NX: usize>(
    posterior: &mut StateEstimate<T, NX>,
    row: &ObservationRow<T, NZ>,
    measured: T,
    variance: T,
    admits: impl FnOnce(T) -> bool,
) -> (Innovation<T>, bool) {
    let innovation = measured - predict_measurement(&posterior.state, row);
    let p = &mut posterior.covariance;
    let (bias, row) = (row.bias::<NX>(), &row.modal);
    let mut w = [T::ZERO; NX];
    let mut scale = T::ZERO;
    for i in 0..NX {
        let mut sum = p[i][0] * row[0];
        for j in 1..NZ {
            sum += p[i][j] * row[j];
        }
        if let Some(bias) = bias {
            sum += p[i][bias];
        }
        w[i] = sum;
    }
    let mut s = T::ZERO;
    for i in 0..NZ {
        scale += p[i][i] * row[i] * row[i];
        s += row[i] * w[i];
    }
    if let Some(bias) = bias {
        scale += p[bias][bias];
        s += w[bias];
    }
    let floor = scale * T::RESOLUTION;
    s += if variance < floor { floor } else { variance };
    let inverse = T::ONE / s;
    let nis = innovation * innovation * inverse;
    let result = Innovation {
        innovation,
        variance: s,
        nis,
    };
    // 1/s is positive for every finite s > 0; both fail on NaN.
    if !(inverse > T::ZERO && nis <= T::MAX && admits(nis)) {
        return (result, false);
    }
    for i in 0..NX {
        let gain = w[i] * inverse;
        posterior.state[i] += gain * innovation;
        for j in 0..i + 1 {
            let value = p[i][j] - gain * w[j];
            p[i][j] = value;
            p[j][i] = value;
        }
    }
    (result, true)
}
