//! Computes sine, cosine, square root and inverse square root in `f32` in few instructions, for the
//! steps of the filters; errors are below 3e-7.
//!
//! Those of libm go through f64 or are computed bit by bit, because they are the last bit
//! right; on a Cortex-M4F that takes some hundred to thousands of instructions. Here
//! everything is f32 arithmetic, the same on every target.

use core::f32::consts::FRAC_2_PI;

/// `pi / 2` in parts that a small whole number times is exact of (Cody and Waite 1980).
const HALF_PI: [f32; 3] = [1.570_312_5, 4.837_513e-4, 7.549_79e-8];

/// Coefficients of `sin r / r` in `r^2` on [-pi/4, pi/4], from `r^2` on (Cephes mathematical
/// library, `sinf.c`).
const SIN: [f32; 3] = [-0.166_666_55, 8.332_161e-3, -1.951_529_6e-4];

/// Coefficients of `cos r` in `r^2` on [-pi/4, pi/4], from `r^4` on (the same source).
const COS: [f32; 3] = [4.166_664_6e-2, -1.388_731_6e-3, 2.443_315_8e-5];

/// `(sin x, cos x)`, right to 1.5e-7 for |x| up to 1000 (rad); not a number where x is none.
#[inline]
pub fn sin_cos(x: f32) -> (f32, f32) {
    let half = if x < 0.0 { -0.5 } else { 0.5 };
    let quarter = (x * FRAC_2_PI + half) as i32;
    let n = quarter as f32;
    let r = ((x - n * HALF_PI[0]) - n * HALF_PI[1]) - n * HALF_PI[2];
    let r2 = r * r;
    let sin = r + r * r2 * (SIN[0] + r2 * (SIN[1] + r2 * SIN[2]));
    let cos = 1.0 - 0.5 * r2 + r2 * r2 * (COS[0] + r2 * (COS[1] + r2 * COS[2]));
    match quarter & 3 {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

/// `1 / sqrt(x)`, right to 3e-7 of it for positive normal `x`; finite for 0.
///
/// A first guess by halving the exponent, then three steps of Newton's method.
#[inline]
pub fn inverse_sqrt(x: f32) -> f32 {
    let half = 0.5 * x;
    let mut y = f32::from_bits(0x5F37_59DF_u32.wrapping_sub(x.to_bits() >> 1));
    for _ in 0..3 {
        y *= 1.5 - half * y * y;
    }
    y
}

/// `sqrt(x)`, right to 3e-7 of it for `x >= 0`.
#[inline]
pub fn sqrt(x: f32) -> f32 {
    x * inverse_sqrt(x)
}

#[cfg(test)]
mod tests {
    use super::inverse_sqrt;
    use super::sin_cos;
    use super::sqrt;

    #[test]
    fn roots_are_those_of_double_precision() {
        let mut x = 1e-30_f32;
        while x < 1e30 {
            let right = libm::sqrt(f64::from(x));
            let off = (f64::from(inverse_sqrt(x)) * right - 1.0).abs();
            assert!(off < 3e-7, "{x}: {off}");
            let off = (f64::from(sqrt(x)) / right - 1.0).abs();
            assert!(off < 3e-7, "{x}: {off}");
            x *= 1.000_37;
        }
        assert_eq!(sqrt(0.0), 0.0);
        assert!(sqrt(f32::NAN).is_nan());
    }

    #[test]
    fn they_are_those_of_double_precision() {
        for i in -200_000..=200_000 {
            let x = i as f32 * 0.005;
            let (sin, cos) = sin_cos(x);
            let (right_sin, right_cos) = libm::sincos(f64::from(x));
            let off = libm::fmax(
                (f64::from(sin) - right_sin).abs(),
                (f64::from(cos) - right_cos).abs(),
            );
            assert!(off < 1.5e-7, "{x}: {off}");
        }
    }

    #[test]
    fn what_is_no_angle_has_none() {
        for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let (sin, cos) = sin_cos(x);
            assert!(sin.is_nan() && cos.is_nan(), "{x}");
        }
    }
}
