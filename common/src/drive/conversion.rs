//! Conversions between `f32` and `i64` that take the instructions of `i32` where the value fits.
//!
//! The core has none for 64 bits: the routines of the compiler take about a hundred instructions.
//! The results are those of `as`.

/// 2^31.
const LIMIT: f32 = 2_147_483_648.0;

/// `value as f32`.
pub(super) fn to_f32(value: i64) -> f32 {
    i32::try_from(value).map_or_else(|_| value as f32, |small| small as f32)
}

/// `value as i64`.
pub(super) fn to_i64(value: f32) -> i64 {
    if libm::fabsf(value) < LIMIT {
        i64::from(value as i32)
    } else {
        value as i64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_are_those_of_as() {
        let edge = i64::from(i32::MAX);
        for value in [
            0,
            1,
            -1,
            16_777_217,
            edge,
            edge + 1,
            -edge - 1,
            -edge - 2,
            i64::MIN,
            i64::MAX,
        ] {
            assert_eq!(to_f32(value).to_bits(), (value as f32).to_bits(), "{value}");
        }
        for value in [
            0.0,
            -0.0,
            0.9,
            -1.9,
            2.1e9,
            LIMIT,
            -LIMIT,
            3e9,
            -1e30,
            f32::NAN,
            f32::INFINITY,
        ] {
            assert_eq!(to_i64(value), value as i64, "{value}");
        }
    }
}
