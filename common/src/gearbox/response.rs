//! What a gauge answers beside its sensitivity times what it senses.

use serde::{Deserialize, Serialize};

use crate::Error;

/// Response of a gauge that is not in proportion to what it senses, `s`:
///
/// `y = o + m (s + n s^2) + c z`, `z+ = z + a (s - z)`.
///
/// `n` bends the response; the zero creeps towards `c s`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Response {
    /// `n`.
    pub bend: f32,
    /// `c`.
    pub creep: f32,
    /// `a`, 0 to 1.
    pub creep_rate: f32,
}

impl Response {
    /// `s + n s^2`, and its slope.
    pub(super) fn bent(&self, sensed: f32) -> (f32, f32) {
        let by = self.bend * sensed;
        (sensed + by * sensed, 1.0 + 2.0 * by)
    }

    pub(super) fn check(&self) -> Result<(), Error> {
        if !(self.bend.is_finite() && self.creep.is_finite()) {
            return Err(Error::NotFinite("channel response"));
        }
        if (0.0..=1.0).contains(&self.creep_rate) {
            Ok(())
        } else {
            Err(Error::OutOfRange("channel response"))
        }
    }
}
