//! Finds the thresholds of an index column that holds a level (0 and 1, a Boolean, a voltage), with
//! hysteresis, and whether the pulse is the high or the low level.

use serde::{Deserialize, Serialize};

use super::index_column::IndexColumn;

/// Spread of the low level over the height of the pulse, at most (quartile
/// deviation): of white noise about one level it is 0.25 to 0.3.
const SPREAD: f64 = 0.1;

/// Height above which the level has risen, as part of that of the pulse.
const RISEN: f64 = 2.0 / 3.0;

/// Height below which it has fallen: with [`RISEN`] a hysteresis of a third.
const FALLEN: f64 = 1.0 / 3.0;

/// Part of the rows that are high from which the level is low during the pulse. Marks on a
/// shaft are shorter than a tenth of a turn, or about half of it, where either edge may be meant.
const ACTIVE_LOW: f64 = 0.9;

/// Where a level is on, and which of its values are.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(super) struct Level {
    /// 1, or -1 where the pulse is the low level.
    sign: f64,
    /// Thresholds of the value times its sign.
    fallen: f64,
    risen: f64,
    /// Whether an empty cell is a value without a pulse.
    empty_is_off: bool,
}

impl Level {
    /// Between `low` and `high`.
    fn between(low: f64, high: f64, active_low: bool) -> Self {
        let (sign, off, on) = if active_low {
            (-1.0, -high, -low)
        } else {
            (1.0, low, high)
        };
        Self {
            sign,
            fallen: off + FALLEN * (on - off),
            risen: off + RISEN * (on - off),
            empty_is_off: false,
        }
    }

    /// Whether the pulse is on in a row; none where the row leaves that open.
    pub(super) fn is_on(&self, value: f64, absent: bool) -> Option<bool> {
        match self.sign * value {
            v if v >= self.risen => Some(true),
            v if v <= self.fallen => Some(false),
            v if v.is_nan() && !absent && self.empty_is_off => Some(false),
            _ => None,
        }
    }

    /// Whether the pulse is the low level.
    pub(super) fn active_low(&self) -> bool {
        self.sign < 0.0
    }
}

impl IndexColumn {
    /// The thresholds of a level; none where it never changes. `active_low`: whether the pulse is
    /// the low level, found from the rows where none.
    pub(super) fn level(&self, active_low: Option<bool>) -> Result<Option<Level>, String> {
        let known = self.values.iter().copied().filter(|v| !v.is_nan());
        let mut values: Vec<f64> = known.collect();
        values.sort_unstable_by(f64::total_cmp);
        let (Some(&least), Some(&most)) = (values.first(), values.last()) else {
            return Ok(None);
        };
        if least == most {
            // Written only where the pulse is; or nothing but one level.
            let is_pulse = values.len() < self.values.len() && most > 0.0;
            return Ok(is_pulse.then(|| Level {
                empty_is_off: true,
                ..Level::between(0.0, most, false)
            }));
        }
        let upper = values.partition_point(|v| *v < 0.5 * (least + most));
        let middle = |values: &[f64]| values[values.len() / 2];
        let (low, high) = values.split_at(upper);
        let high_part = high.len() as f64 / values.len() as f64;
        let active_low = active_low.unwrap_or(high_part > ACTIVE_LOW);
        let off = if active_low { high } else { low };
        let (low, high) = (middle(low), middle(high));
        let spread = 0.5 * (off[3 * off.len() / 4] - off[off.len() / 4]) / (high - low);
        if spread > SPREAD {
            return Err(format!(
                "found values spread from {least} to {most} without a low level ({:.0} % of the \
                 height scattered)",
                100.0 * spread
            ));
        }
        Ok(Some(Level::between(low, high, active_low)))
    }
}
