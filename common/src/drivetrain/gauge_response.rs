//! Computes the response of a gauge to what it senses beyond a constant sensitivity
//! (`GaugeResponse`): quadratic term, creep, hysteresis and temperature. Its delay in samples is a
//! parameter here and is applied where the strain map is read.

use serde::{Deserialize, Serialize};

use crate::Error;

/// Response of a gauge that is not in proportion to what it senses, `s` (parts of nominal):
///
/// `y = o + (1 + g w) m (s + n s^2) + c z + k q + h w`, `z+ = z + a (s - z)`,
/// `q+ = q + ds / l - |ds / l| q`.
///
/// `n` bends the response; the zero creeps towards `c s`; `k q` is hysteresis (Bouc-Wen); `w` is
/// how much warmer the machine is than when the zero was taken (K). A reading that comes late has
/// `m` where the carrier was then.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GaugeResponse {
    /// `n` (1 / nominal).
    pub bend: f32,
    /// `c` (the channel's unit).
    pub creep: f32,
    /// `a`, of one sample, 0 to 1.
    pub creep_rate: f32,
    /// `k` (the channel's unit).
    pub hysteresis: f32,
    /// `1 / l` (1 / nominal), >= 0.
    pub turning: f32,
    /// `h` (the channel's unit per K).
    pub zero_per_k: f32,
    /// `g` (1/K).
    pub gain_per_k: f32,
    /// Samples by which the reading is old, >= 0.
    pub late: f32,
}

/// Part of `l` by which what is sensed has to be ahead before it counts as moved.
const MOTION_THRESHOLD: f32 = 0.02;

/// The same in standard deviations of its estimate, whose noise would otherwise erase the
/// hysteresis.
const MOTION_SIGMA: f32 = 6.0;

/// State of creep and hysteresis of one gauge.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct HysteresisState {
    /// `z`.
    crept: f32,
    /// What is sensed, as far as it counts as moved.
    moved: f32,
    /// `q`.
    turned: f32,
    /// `c z + k q`.
    pub(crate) zero: f32,
}

impl GaugeResponse {
    /// Whether it has a state: creep or hysteresis.
    pub(crate) fn has_state(&self) -> bool {
        self.creep_rate > 0.0 || self.turning > 0.0
    }

    /// One sample on; `variance` is that of what is sensed.
    #[inline(never)]
    pub(crate) fn advance(&self, memory: &mut HysteresisState, sensed: f32, variance: f32) {
        memory.crept += self.creep_rate * (sensed - memory.crept);
        let ahead = (sensed - memory.moved) * self.turning;
        // The larger of the two, also where the variance is no number.
        let lag = (MOTION_SIGMA * libm::sqrtf(variance) * self.turning).max(MOTION_THRESHOLD);
        let step = ahead - ahead.clamp(-lag, lag);
        if step != 0.0 {
            memory.moved += step / self.turning;
            let turned = memory.turned + step - libm::fabsf(step) * memory.turned;
            // A step beyond the whole loop ends on its flank.
            memory.turned = turned.clamp(-1.0, 1.0);
        }
        memory.zero = self.creep * memory.crept + self.hysteresis * memory.turned;
    }

    /// `(1 + g w) (s + n s^2)`, and its slope.
    pub(crate) fn output(&self, sensed: f32, warming: f32) -> (f32, f32) {
        let by = self.bend * sensed;
        let gain = 1.0 + self.gain_per_k * warming;
        (gain * (sensed + by * sensed), gain * (1.0 + 2.0 * by))
    }

    /// `c z + k q + h w`.
    pub(crate) fn offset(&self, remembered: f32, warming: f32) -> f32 {
        remembered + self.zero_per_k * warming
    }

    pub(crate) fn check(&self) -> Result<(), Error> {
        let numbers = [
            self.bend,
            self.creep,
            self.hysteresis,
            self.zero_per_k,
            self.gain_per_k,
        ];
        if !numbers.iter().all(|number| number.is_finite()) {
            return Err(Error::NotFinite("channel response"));
        }
        let turns = self.turning >= 0.0 && self.turning.is_finite();
        let late = self.late >= 0.0 && self.late.is_finite();
        if (0.0..=1.0).contains(&self.creep_rate) && turns && late {
            Ok(())
        } else {
            Err(Error::OutOfRange("channel response"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOOP: GaugeResponse = GaugeResponse {
        bend: 0.0,
        creep: 0.0,
        creep_rate: 0.0,
        hysteresis: 2.0,
        turning: 10.0,
        zero_per_k: 0.0,
        gain_per_k: 0.0,
        late: 0.0,
    };

    /// By hand: up from 0 by `s`, `q = 1 - exp(-s / l)`; back again it is that less
    /// `(1 + q) (1 - exp(-s / l))`. The way counts but for a fiftieth of `l` at either end.
    #[test]
    fn a_loop_is_wide_in_the_middle_and_noise_does_not_close_it() {
        let mut memory = HysteresisState::default();
        let mut walk = |from: f32, to: f32, noise: f32| {
            for i in 0..=1000_u16 {
                let part = f32::from(i) / 1000.0;
                let wiggle = if i % 2 == 0 { noise } else { -noise };
                LOOP.advance(
                    &mut memory,
                    from + part * (to - from) + wiggle,
                    noise * noise,
                );
            }
            memory.zero
        };
        let up = walk(0.0, 0.1, 0.0);
        assert!((up - 2.0 * 0.632).abs() < 0.03, "{up}");
        let held = walk(0.1, 0.1, 0.015);
        assert!((held - up).abs() < 0.03, "{held}");
        let down = walk(0.1, 0.0, 0.0);
        assert!(
            (down - 2.0 * (0.632 - 1.632 * 0.632)).abs() < 0.06,
            "{down}"
        );
        // A step beyond all bounds ends on the flank.
        assert_eq!(walk(1e9, 1e9, 0.0), 2.0);
    }
}
