//! Keeps the last 32 readings of one signal and gives that of less than 31 samples earlier, a whole
//! or fractional number, interpolated between the two nearest (`DelayLine`).

use serde::{Deserialize, Serialize};

use crate::io::fault::Fault;
use crate::io::measurement::Measured;

/// Most samples by which a signal can be delayed, exclusive.
pub const MAX_DELAY: f32 = 31.0;

/// Readings that are kept: whole samples of the longest delay, and one on either side.
const KEPT: usize = 32;

/// The last readings of one signal.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct DelayLine<T> {
    readings: [Measured<T>; KEPT],
    newest: usize,
}

impl<T: Copy> DelayLine<T> {
    /// No reading yet.
    pub(crate) fn empty() -> Self {
        Self {
            readings: [Err(Fault::Missing); KEPT],
            newest: 0,
        }
    }

    /// Takes the reading of the next sample.
    pub(crate) fn push(&mut self, reading: Measured<T>) {
        self.newest = (self.newest + 1) % KEPT;
        if let Some(slot) = self.readings.get_mut(self.newest) {
            *slot = reading;
        }
    }

    /// The reading `delay` samples before the newest, on the straight line `between` the two
    /// nearest: `between(newer, older, part of the way to the older)`.
    pub(crate) fn at<U>(&self, delay: f32, between: impl FnOnce(T, T, f32) -> U) -> Measured<U> {
        let whole = delay as usize;
        let part = delay - whole as f32;
        let newer = self.back(whole)?;
        let older = if part > 0.0 {
            self.back(whole + 1)?
        } else {
            newer
        };
        Ok(between(newer, older, part))
    }

    fn back(&self, samples: usize) -> Measured<T> {
        let place = (self.newest + KEPT - samples % KEPT) % KEPT;
        *self.readings.get(place).unwrap_or(&Err(Fault::Missing))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn linear(newer: f32, older: f32, part: f32) -> f32 {
        newer + part * (older - newer)
    }

    #[test]
    fn a_ramp_is_delayed_by_whole_and_fractional_samples() {
        for delay in [0.0, 0.25, 1.0, 2.5, 30.75] {
            let mut line = DelayLine::empty();
            for k in 0..100 {
                line.push(Ok(k as f32));
                let seen = line.at(delay, linear);
                if k as f32 >= delay + 1.0 {
                    assert_eq!(seen, Ok(k as f32 - delay));
                } else if (k as f32) < delay {
                    assert_eq!(seen, Err(Fault::Missing), "{delay} {k}");
                }
            }
        }
    }

    #[test]
    fn a_missing_reading_is_missing_when_its_turn_comes() {
        let mut line = DelayLine::empty();
        for k in 0..8 {
            line.push(if k == 4 {
                Err(Fault::Stuck)
            } else {
                Ok(k as f32)
            });
            // Between the readings k - 1 and k - 2; those before 0 and number 4 are missing.
            let seen = line.at(1.5, linear);
            assert_eq!(seen.is_err(), k < 2 || k == 5 || k == 6, "{k}");
        }
    }
}
