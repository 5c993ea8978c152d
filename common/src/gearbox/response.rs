//! What a gauge answers beside its sensitivity times what it senses.

use serde::{Deserialize, Serialize};

use crate::Error;

/// Response of a gauge that is not in proportion to what it senses, `s`:
///
/// `y = o + (1 + g w) m (s + n s^2) + c z + h w`, `z+ = z + a (s - z)`.
///
/// `n` bends the response; the zero creeps towards `c s`; `w` is how much warmer the machine is
/// than when the zero was taken [K].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Response {
    /// `n`.
    pub bend: f32,
    /// `c`.
    pub creep: f32,
    /// `a`, 0 to 1.
    pub creep_rate: f32,
    /// `h` [1/K].
    pub zero_per_k: f32,
    /// `g` [1/K].
    pub gain_per_k: f32,
}

impl Response {
    /// `(1 + g w) (s + n s^2)`, and its slope.
    pub(super) fn bent(&self, sensed: f32, warming: f32) -> (f32, f32) {
        let by = self.bend * sensed;
        let gain = 1.0 + self.gain_per_k * warming;
        (gain * (sensed + by * sensed), gain * (1.0 + 2.0 * by))
    }

    /// `c z + h w`.
    pub(super) fn zero(&self, crept: f32, warming: f32) -> f32 {
        self.creep * crept + self.zero_per_k * warming
    }

    pub(super) fn check(&self) -> Result<(), Error> {
        let numbers = [self.bend, self.creep, self.zero_per_k, self.gain_per_k];
        if !numbers.iter().all(|number| number.is_finite()) {
            return Err(Error::NotFinite("channel response"));
        }
        if (0.0..=1.0).contains(&self.creep_rate) {
            Ok(())
        } else {
            Err(Error::OutOfRange("channel response"))
        }
    }
}
