//! Splits a signal into a low-pass and a high-pass part by a second-order Butterworth filter
//! (`Butterworth`), sample by sample; the cut-off frequency may move.

use crate::error::Error;

/// Coefficients for one cut-off frequency.
///
/// `H(s) = 1 / (s^2 + sqrt(2) s + 1)` and its high-pass twin `s^2 H(s)`,
/// bilinear transform prewarped at the cut-off: `g = tan(pi f_c dt)`.
///
/// Realised as a state-variable filter with trapezoidal integrators. Its
/// transfer function is that of the usual biquad, but its numbers stay
/// accurate where the cut-off is far below the sample rate (a biquad's
/// `1 + a1 + a2` cancels: 1 % of the gain at a thousandth of it in f32), its
/// state means the same at every cut-off, so that a moving cut-off gives no
/// step, and both outputs come from one state.
///
/// Source: Kerst et al. 2019, eq. (10)-(11); Simper, Linear Trapezoidal
/// Integrated State Variable Filter, 2013.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Butterworth {
    a1: f32,
    a2: f32,
    a3: f32,
}

/// The two integrators of the filter.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ButterworthState {
    band: f32,
    low: f32,
}

/// Both outputs for one sample, in the unit of the input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Split {
    /// Below the cut-off.
    pub low: f32,
    /// Above the cut-off.
    pub high: f32,
}

impl Butterworth {
    /// Lowest and highest cut-off as a share of the sample rate.
    const RANGE: (f32, f32) = (1e-5, 0.49);

    /// Filter with cut-off `cutoff_hz` (-3 dB) (Hz) at a sample period `dt_s`
    /// (s); `cutoff_hz * dt_s` in [1e-5, 0.49].
    ///
    /// # Errors
    /// `OutOfRange("cutoff")`.
    pub fn try_new(cutoff_hz: f32, dt_s: f32) -> Result<Self, Error> {
        let share = cutoff_hz * dt_s;
        if (Self::RANGE.0..=Self::RANGE.1).contains(&share) {
            Ok(Self::design(share))
        } else {
            Err(Error::OutOfRange("cutoff"))
        }
    }

    /// Moves the cut-off to `cutoff_hz` (Hz), held within the range of
    /// [`Butterworth::try_new`]; NaN leaves it where it is. The state stays valid.
    pub fn retune(&mut self, cutoff_hz: f32, dt_s: f32) {
        let share = cutoff_hz * dt_s;
        if !share.is_nan() {
            *self = Self::design(share.clamp(Self::RANGE.0, Self::RANGE.1));
        }
    }

    fn design(share: f32) -> Self {
        let g = libm::tanf(core::f32::consts::PI * share);
        let a1 = 1.0 / (1.0 + g * (g + core::f32::consts::SQRT_2));
        let a2 = g * a1;
        Self { a1, a2, a3: g * a2 }
    }

    /// Filters one sample; one that is not finite is answered with the state
    /// as it was, `high` 0, and forgotten.
    #[inline]
    pub fn step(&self, state: &mut ButterworthState, input: f32) -> Split {
        let v3 = input - state.low;
        let band = self.a1 * state.band + self.a2 * v3;
        let low = state.low + self.a2 * state.band + self.a3 * v3;
        let next = ButterworthState {
            band: 2.0 * band - state.band,
            low: 2.0 * low - state.low,
        };
        if !(next.band.is_finite() && next.low.is_finite()) {
            return Split {
                low: state.low,
                high: 0.0,
            };
        }
        *state = next;
        Split {
            low,
            high: input - core::f32::consts::SQRT_2 * band - low,
        }
    }
}

impl ButterworthState {
    /// State of a filter that has seen `input` for ever: no transient at the start.
    pub fn settled(input: f32) -> Self {
        Self {
            band: 0.0,
            low: if input.is_finite() { input } else { 0.0 },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `f_c = f_s / 4`: `g = 1`, `a1 = a2 = a3 = 1 / (2 + sqrt(2))`; first
    /// output of a unit step `a3 = 0.2928932`, of the high-pass the same.
    #[test]
    fn step_response_by_hand() {
        let filter = Butterworth::try_new(250.0, 0.001).unwrap();
        let mut state = ButterworthState::default();
        let first = filter.step(&mut state, 1.0);
        assert!((first.low - 0.292_893_2).abs() < 1e-6);
        assert!((first.high - 0.292_893_2).abs() < 1e-6);
    }

    #[test]
    fn gain_at_rest_is_one_far_below_the_sample_rate() {
        let filter = Butterworth::try_new(0.1, 0.001).unwrap();
        let mut state = ButterworthState::default();
        let mut last = Split {
            low: 0.0,
            high: 0.0,
        };
        for _ in 0..60_000 {
            last = filter.step(&mut state, 1000.0);
        }
        assert!((last.low - 1000.0).abs() < 0.1, "{last:?}");
        assert!(last.high.abs() < 0.1, "{last:?}");
    }

    #[test]
    fn a_moving_cutoff_gives_no_step() {
        let mut filter = Butterworth::try_new(5.0, 0.001).unwrap();
        let mut state = ButterworthState::settled(100.0);
        for cutoff in [1.0, 200.0, 0.5, 400.0, f32::NAN, 1e9, -3.0] {
            filter.retune(cutoff, 0.001);
            for _ in 0..50 {
                let out = filter.step(&mut state, 100.0);
                assert!(
                    (out.low - 100.0).abs() < 1e-3 && out.high.abs() < 1e-3,
                    "{cutoff} {out:?}"
                );
            }
        }
    }

    #[test]
    fn what_is_not_a_number_is_forgotten() {
        let filter = Butterworth::try_new(10.0, 0.001).unwrap();
        let mut state = ButterworthState::settled(1.0);
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert_eq!(
                filter.step(&mut state, bad),
                Split {
                    low: 1.0,
                    high: 0.0
                }
            );
        }
        assert_eq!(state, ButterworthState::settled(1.0));
        assert_eq!(
            Butterworth::try_new(600.0, 0.001),
            Err(Error::OutOfRange("cutoff"))
        );
    }
}
