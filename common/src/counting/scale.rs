//! Quantises a load into one of 128 levels of equal width (`LevelScale`); a load beyond the scale
//! gets the nearest level and is marked.

use serde::{Deserialize, Serialize};

use super::LEVELS;
use crate::Error;

/// [`LEVELS`] levels of equal width.
///
/// `level = floor((load - low) / width)`, 0 to `LEVELS - 1`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LevelScale {
    low: f32,
    width: f32,
}

/// A level, and whether the load lies beyond the scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Placed {
    /// The level, the nearest one for a load beyond the scale.
    pub level: u8,
    /// Whether the load lies beyond the scale.
    pub is_beyond: bool,
}

impl LevelScale {
    /// Levels from `low` on, each `width` wide [unit of the load].
    ///
    /// # Errors
    /// `Error::NotPositive` when `width` is not above zero; `Error::NotFinite`
    /// when an end of the scale is not finite; `Error::OutOfRange` when
    /// neighbouring levels are the same number in f32.
    pub fn try_new(low: f32, width: f32) -> Result<Self, Error> {
        if !(width > 0.0 && width.is_finite()) {
            return Err(Error::NotPositive("width of a level"));
        }
        let scale = Self { low, width };
        let [first, last] = scale.ends();
        if !(first.is_finite() && last.is_finite()) {
            return Err(Error::NotFinite("scale of levels"));
        }
        // f32 has 24 bits; a quarter of a level must remain visible at both ends.
        let quarter = 0.25 * width;
        if first + quarter == first || last - quarter == last {
            return Err(Error::OutOfRange("width of a level"));
        }
        Ok(scale)
    }

    /// Levels that cover `from` to `to` [unit of the load].
    ///
    /// # Errors
    /// As [`Self::try_new`].
    pub fn covering(from: f32, to: f32) -> Result<Self, Error> {
        Self::try_new(from, (to - from) / LEVELS as f32)
    }

    /// Both ends [unit of the load].
    pub fn ends(&self) -> [f32; 2] {
        [self.low, self.low + LEVELS as f32 * self.width]
    }

    /// Width of a level [unit of the load].
    pub fn width(&self) -> f32 {
        self.width
    }

    /// The middle of a level [unit of the load].
    pub fn middle(&self, level: u8) -> f32 {
        self.low + (f32::from(level) + 0.5) * self.width
    }

    /// The level of a finite load.
    pub fn place(&self, load: f32) -> Placed {
        let position = (load - self.low) / self.width;
        // On the scale, the cast cuts as floor does; it takes one instruction.
        let level = position as u32;
        Placed {
            level: level.min(LEVELS as u32 - 1) as u8,
            is_beyond: position < 0.0 || level >= LEVELS as u32,
        }
    }

    /// Whether the numbers are those of a scale, after they came from bytes.
    pub(super) fn is_valid(self) -> bool {
        Self::try_new(self.low, self.width).is_ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn middles_of_levels_return_to_them_and_ends_are_beyond() {
        let scale = LevelScale::covering(-1000.0, 1000.0).unwrap();
        for level in 0..LEVELS as u8 {
            let placed = scale.place(scale.middle(level));
            assert_eq!((placed.level, placed.is_beyond), (level, false));
        }
        assert_eq!(
            scale.place(-1000.0),
            Placed {
                level: 0,
                is_beyond: false
            }
        );
        assert_eq!(
            scale.place(1000.0),
            Placed {
                level: 127,
                is_beyond: true
            }
        );
        assert_eq!(
            scale.place(-1000.1),
            Placed {
                level: 0,
                is_beyond: true
            }
        );
        assert_eq!(
            scale.place(f32::MAX),
            Placed {
                level: 127,
                is_beyond: true
            }
        );
    }

    #[test]
    fn what_is_no_scale_is_refused() {
        for (from, to) in [
            (0.0, 0.0),
            (1.0, -1.0),
            (f32::NAN, 1.0),
            (0.0, f32::INFINITY),
        ] {
            assert!(LevelScale::covering(from, to).is_err(), "{from} to {to}");
        }
        assert_eq!(
            LevelScale::covering(1.0e8, 1.0e8 + 128.0),
            Err(Error::OutOfRange("width of a level"))
        );
        assert!(LevelScale::covering(-f32::MAX, f32::MAX).is_err());
    }
}
