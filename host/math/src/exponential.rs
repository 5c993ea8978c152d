//! Computes the matrix exponential of a square matrix by scaling and squaring with a Padé
//! approximant.

use faer::linalg::solvers::Solve;
use faer::{Mat, Scale};

/// Coefficients of the [13/13] Pade approximant of the exponential.
const PADE_13: [f64; 14] = [
    64_764_752_532_480_000.0,
    32_382_376_266_240_000.0,
    7_771_770_303_897_600.0,
    1_187_353_796_428_800.0,
    129_060_195_264_000.0,
    10_559_470_521_600.0,
    670_442_572_800.0,
    33_522_128_640.0,
    1_323_241_920.0,
    40_840_800.0,
    960_960.0,
    16_380.0,
    182.0,
    1.0,
];

/// Largest norm at which the approximant is exact to double precision.
const THETA_13: f64 = 5.371_920_351_148_152;

/// `exp(a)` for a square matrix, by scaling and squaring; NaN where `a` is not finite.
///
/// Source: Higham, The scaling and squaring method for the matrix exponential
/// revisited, SIAM J. Matrix Anal. Appl. 26 (2005), algorithm 2.3 with m = 13.
pub fn exponential(a: &Mat<f64>) -> Mat<f64> {
    let n = a.nrows();
    let norm = (0..n)
        .map(|j| a.col(j).iter().map(|x| x.abs()).sum::<f64>())
        .fold(0.0, f64::max);
    if !norm.is_finite() {
        return Mat::from_fn(n, n, |_, _| f64::NAN);
    }
    let squarings = if norm > THETA_13 {
        (norm / THETA_13).log2().ceil() as i32
    } else {
        0
    };
    let a = Scale(0.5_f64.powi(squarings)) * a;
    let identity = Mat::<f64>::identity(n, n);
    let a2 = &a * &a;
    let a4 = &a2 * &a2;
    let a6 = &a4 * &a2;
    let b = |k: usize| Scale(PADE_13[k]);
    let u = &a
        * (&a6 * (b(13) * &a6 + b(11) * &a4 + b(9) * &a2)
            + b(7) * &a6
            + b(5) * &a4
            + b(3) * &a2
            + b(1) * &identity);
    let v = &a6 * (b(12) * &a6 + b(10) * &a4 + b(8) * &a2)
        + b(6) * &a6
        + b(4) * &a4
        + b(2) * &a2
        + b(0) * &identity;
    let mut result = (&v - &u).partial_piv_lu().solve(&v + &u);
    for _ in 0..squarings {
        result = &result * &result;
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;
    use faer::mat;

    #[test]
    fn a_rotation_is_the_exponential_of_its_generator() {
        let angle = 20.0;
        let e = exponential(&mat![[0.0, -angle], [angle, 0.0]]);
        for (found, expected) in [
            (e[(0, 0)], angle.cos()),
            (e[(0, 1)], -angle.sin()),
            (e[(1, 0)], angle.sin()),
            (e[(1, 1)], angle.cos()),
        ] {
            assert!((found - expected).abs() < 1e-13, "{found} {expected}");
        }
    }

    #[test]
    fn what_is_not_finite_ends_as_nan() {
        for entry in [f64::INFINITY, f64::NAN, 1e308] {
            let e = exponential(&mat![[entry, entry], [entry, entry]]);
            assert!(e[(0, 0)].is_nan() || e[(0, 0)].is_infinite());
        }
    }

    #[test]
    fn a_nilpotent_matrix_gives_its_finite_series() {
        let e = exponential(&mat![[0.0, 2.0, 3.0], [0.0, 0.0, 4.0], [0.0, 0.0, 0.0]]);
        assert!((e[(0, 2)] - (3.0 + 0.5 * 2.0 * 4.0)).abs() < 1e-14);
    }
}
