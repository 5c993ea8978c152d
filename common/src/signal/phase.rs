//! Represents an angle as a fraction of a turn in 64 bits (`Phase`), exact and without drift over
//! any number of turns; converts it from and to radians and to a place in a table. Also wraps an
//! angle in radians.

use serde::{Deserialize, Serialize};

/// An angle modulo one turn; 2^64 is a full turn.
///
/// Wrapping integer arithmetic keeps the angle of a shaft that turns for
/// years as exact as at the first count, which no float does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Phase(pub u64);

/// 2 pi / 2^32: radians in one unit of the upper word.
const RAD_PER_UPPER: f32 = core::f32::consts::TAU / 4_294_967_296.0;

/// Units of the upper word in one radian.
pub(crate) const UPPER_PER_RAD: f32 = 4_294_967_296.0 / core::f32::consts::TAU;

impl Phase {
    /// The phase of `rad` from -pi to pi, to 2^-24 of it; beyond, that of the nearer end.
    pub fn from_small_rad(rad: f32) -> Self {
        Self(u64::from((rad * UPPER_PER_RAD) as i32 as u32) << 32)
    }

    /// The phase of `rad`, taken modulo one turn.
    ///
    /// Non-finite angles give phase 0.
    pub fn from_rad(rad: f32) -> Self {
        if libm::fabsf(rad) <= core::f32::consts::PI {
            return Self::from_small_rad(rad);
        }
        let turns = rad * core::f32::consts::FRAC_1_PI * 0.5;
        let fraction = turns - libm::floorf(turns);
        // `as` saturates: a fraction that rounded up to 1 stays inside the turn.
        Self(u64::from((fraction * 4_294_967_296.0) as u32) << 32)
    }

    /// The angle in [-pi, pi) (rad).
    pub fn to_rad(self) -> f32 {
        (self.0 >> 32) as u32 as i32 as f32 * RAD_PER_UPPER
    }

    /// This phase turned by `other`.
    #[must_use]
    pub fn wrapping_add(self, other: Self) -> Self {
        Self(self.0.wrapping_add(other.0))
    }

    /// The phase that turns `other` into this one.
    #[must_use]
    pub fn wrapping_sub(self, other: Self) -> Self {
        Self(self.0.wrapping_sub(other.0))
    }

    /// This phase turned by `counts` steps of `step` each.
    #[must_use]
    pub fn advanced(self, counts: i32, step: PhaseStep) -> Self {
        Self(
            self.0
                .wrapping_add(step.0.wrapping_mul(i64::from(counts) as u64)),
        )
    }

    /// Position in a table of 2^`log2_len` entries around the turn: the entry
    /// at or before the angle, and the fraction in [0, 1) towards the next.
    pub fn table_index(self, log2_len: u32) -> (usize, f32) {
        let upper = (self.0 >> 32) as u32;
        // In two steps: a shift by 32 is none.
        let entry = (upper >> 1) >> (31 - log2_len.min(31));
        // 24 bits below the entry: what an f32 holds exactly.
        let below = (upper << log2_len.min(31)) >> 8;
        (entry as usize, below as f32 * (1.0 / 16_777_216.0))
    }
}

/// The angle of one encoder count, in the unit of [`Phase`]; two's complement
/// for an encoder that counts against the direction of turning.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct PhaseStep(pub u64);

impl PhaseStep {
    /// The phase after one step from 0.
    pub fn into_phase(self) -> Phase {
        Phase(self.0)
    }
}

/// Wraps an angle into [-pi, pi).
///
/// `a - 2 pi floor(a / 2 pi + 1/2)`; a non-finite angle stays non-finite. Where turns are so many
/// that their rounding leaves that range, -pi.
pub fn wrap_rad(a: f32) -> f32 {
    use core::f32::consts::{FRAC_1_PI, PI, TAU};
    if (-PI..PI).contains(&a) {
        return a;
    }
    let turns = libm::floorf(a * (0.5 * FRAC_1_PI) + 0.5);
    let wrapped = a - turns * TAU;
    // Both ends are the same angle; NaN stays NaN.
    if (-PI..PI).contains(&wrapped) || wrapped.is_nan() {
        wrapped
    } else {
        -PI
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quarter_turn_is_a_quarter_of_the_range() {
        let quarter = Phase(1 << 62);
        assert!((quarter.to_rad() - core::f32::consts::FRAC_PI_2).abs() < 1e-6);
        assert!(
            (Phase::from_rad(-core::f32::consts::FRAC_PI_2).to_rad()
                + core::f32::consts::FRAC_PI_2)
                .abs()
                < 1e-6
        );
    }

    #[test]
    fn a_small_angle_keeps_its_digits_and_a_large_one_stays_at_half_a_turn() {
        for rad in [1e-6_f32, -1e-6, 0.02, -3.0] {
            let back = Phase::from_small_rad(rad).to_rad();
            assert!((back - rad).abs() < 2e-7 * rad.abs() + 2e-9, "{back}");
        }
        assert!((Phase::from_small_rad(9.0).to_rad() - core::f32::consts::PI).abs() < 1e-6);
        assert_eq!(Phase::from_small_rad(f32::NAN), Phase::default());
    }

    #[test]
    fn ten_million_turns_of_a_count_that_divides_no_turn_end_where_they_started() {
        // 4096 counts a turn behind a ratio of 61.8: 253132.8 counts a turn.
        let step = PhaseStep((18_446_744_073_709_551_616.0_f64 / (4096.0 * 61.8)) as u64);
        let five_turns = 1_265_664;
        let mut phase = Phase::default();
        for _ in 0..2_000_000 {
            phase = phase.advanced(five_turns, step);
        }
        assert!(phase.to_rad().abs() < 1e-4, "{}", phase.to_rad());
    }

    #[test]
    fn a_wrapped_angle_is_within_half_a_turn() {
        for a in [
            1e3_f32,
            -1e6,
            1e8,
            -3e9,
            1e20,
            f32::MAX,
            core::f32::consts::PI,
        ] {
            let wrapped = wrap_rad(a);
            assert!(
                (-core::f32::consts::PI..core::f32::consts::PI).contains(&wrapped),
                "{a}: {wrapped}"
            );
        }
        assert!(wrap_rad(f32::INFINITY).is_nan());
    }

    #[test]
    fn a_position_in_a_table_is_entry_and_fraction() {
        let (entry, fraction) = Phase(0x8040_0000_0000_0000).table_index(8);
        assert_eq!((entry, fraction), (0x80, 0.25));
        assert_eq!(Phase(u64::MAX).table_index(8).0, 255);
        assert!(Phase(u64::MAX).table_index(8).1 < 1.0);
        assert_eq!(Phase(u64::MAX).table_index(0).0, 0);
    }

    #[test]
    fn wrapping_keeps_the_angle() {
        for (a, b) in [
            (3.5, 3.5 - core::f32::consts::TAU),
            (-3.5, core::f32::consts::TAU - 3.5),
            (1.0, 1.0),
        ] {
            assert!((wrap_rad(a) - b).abs() < 1e-6);
        }
    }
}
