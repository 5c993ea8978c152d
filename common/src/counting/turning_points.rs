//! Finds the turning points of a load in the sequence of its levels (`TurningPoints`): a reversal
//! counts once the load has moved back by the hysteresis gate, at least one level.

use serde::{Deserialize, Serialize};

use super::LEVELS;
use crate::Error;

/// Finds turning points with a hysteresis gate.
///
/// A maximum is a turning point once the load has fallen by `gate` levels from
/// it, a minimum once it has risen by them; `gate = 1` keeps every reversal of
/// levels. The first turning point is the extreme from which the load first
/// moves by the gate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct TurningPoints {
    gate: u8,
    motion: Motion,
}

/// How the load moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
enum Motion {
    /// Before the first level.
    Before,
    /// Within the gate since the first level.
    Within {
        low: u8,
        high: u8,
        high_is_later: bool,
    },
    /// Upwards, with the highest level since the last turning point.
    Up(u8),
    /// Downwards, with the lowest level since the last turning point.
    Down(u8),
}

impl TurningPoints {
    /// None found yet; `gate` (levels), 1 to `LEVELS - 1`.
    ///
    /// # Errors
    /// `Error::OutOfRange` for another gate.
    pub fn try_new(gate: u8) -> Result<Self, Error> {
        let points = Self {
            gate,
            motion: Motion::Before,
        };
        if points.is_valid() {
            Ok(points)
        } else {
            Err(Error::OutOfRange("gate"))
        }
    }

    /// The gate (levels).
    pub fn gate(&self) -> u8 {
        self.gate
    }

    /// Takes the next level and gives the turning point that it confirms.
    pub fn push(&mut self, level: u8) -> Option<u8> {
        let gate = self.gate;
        let is_gate = |from: u8, to: u8| from.saturating_add(gate) <= to;
        let (motion, found) = match self.motion {
            Motion::Before => (
                Motion::Within {
                    low: level,
                    high: level,
                    high_is_later: false,
                },
                None,
            ),
            Motion::Within { low, .. } if is_gate(low, level) => (Motion::Up(level), Some(low)),
            Motion::Within { high, .. } if is_gate(level, high) => {
                (Motion::Down(level), Some(high))
            }
            Motion::Within {
                low,
                high,
                high_is_later,
            } => (
                Motion::Within {
                    low: low.min(level),
                    high: high.max(level),
                    high_is_later: level > high || (level >= low && high_is_later),
                },
                None,
            ),
            Motion::Up(peak) if is_gate(level, peak) => (Motion::Down(level), Some(peak)),
            Motion::Up(peak) => (Motion::Up(peak.max(level)), None),
            Motion::Down(valley) if is_gate(valley, level) => (Motion::Up(level), Some(valley)),
            Motion::Down(valley) => (Motion::Down(valley.min(level)), None),
        };
        self.motion = motion;
        found
    }

    /// The extremes that are not confirmed yet, in their order: they end the
    /// sequence, where it ends here.
    pub fn unconfirmed(&self) -> impl Iterator<Item = u8> {
        let (first, second) = match self.motion {
            Motion::Before => (None, None),
            Motion::Within { low, high, .. } if low == high => (Some(low), None),
            Motion::Within {
                low,
                high,
                high_is_later: true,
            } => (Some(low), Some(high)),
            Motion::Within { low, high, .. } => (Some(high), Some(low)),
            Motion::Up(extreme) | Motion::Down(extreme) => (Some(extreme), None),
        };
        first.into_iter().chain(second)
    }

    /// How the load moves, as bytes.
    pub(super) fn motion_bytes(self) -> [u8; 4] {
        match self.motion {
            Motion::Before => [0; 4],
            Motion::Within {
                low,
                high,
                high_is_later,
            } => [1, low, high, high_is_later.into()],
            Motion::Up(peak) => [2, peak, 0, 0],
            Motion::Down(valley) => [3, valley, 0, 0],
        }
    }

    /// Sets how the load moves; false where the bytes say no such thing.
    pub(super) fn set_motion(&mut self, bytes: [u8; 4]) -> bool {
        self.motion = match bytes {
            [0, 0, 0, 0] => Motion::Before,
            [1, low, high, later @ (0 | 1)] => Motion::Within {
                low,
                high,
                high_is_later: later == 1,
            },
            [2, peak, 0, 0] => Motion::Up(peak),
            [3, valley, 0, 0] => Motion::Down(valley),
            _ => return false,
        };
        true
    }

    /// Whether the state is one that a sequence can lead to, after it came from bytes.
    pub(super) fn is_valid(self) -> bool {
        let levels = LEVELS as u8;
        let motion = match self.motion {
            Motion::Before => true,
            Motion::Within { low, high, .. } => {
                low <= high && high < levels && high - low < self.gate
            }
            Motion::Up(level) | Motion::Down(level) => level < levels,
        };
        (1..levels).contains(&self.gate) && motion
    }

    /// Whether the unconfirmed extreme follows `last`, the last turning point, by the gate.
    pub(super) fn follows(self, last: Option<u8>) -> bool {
        match (self.motion, last) {
            (Motion::Before | Motion::Within { .. }, last) => last.is_none(),
            (Motion::Up(peak), Some(last)) => last < peak && peak - last >= self.gate,
            (Motion::Down(valley), Some(last)) => valley < last && last - valley >= self.gate,
            (Motion::Up(_) | Motion::Down(_), None) => false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use heapless::Vec;

    fn found(gate: u8, levels: &[u8]) -> (Vec<u8, 32>, Vec<u8, 2>) {
        let mut points = TurningPoints::try_new(gate).unwrap();
        let confirmed = levels
            .iter()
            .filter_map(|&level| points.push(level))
            .collect();
        (confirmed, points.unconfirmed().collect())
    }

    #[test]
    fn reversals_of_a_sequence() {
        let (confirmed, end) = found(1, &[5, 5, 7, 9, 9, 3, 4, 4, 1]);
        assert_eq!((&confirmed[..], &end[..]), (&[5, 9, 3, 4][..], &[1][..]));
        assert_eq!(found(1, &[]), (Vec::new(), Vec::new()));
        assert_eq!(found(1, &[8, 8]).1[..], [8]);
    }

    #[test]
    fn movements_within_the_gate_are_no_turning_points() {
        let (confirmed, end) = found(3, &[10, 11, 9, 12, 10, 14, 12, 13, 8, 10, 20]);
        assert_eq!((&confirmed[..], &end[..]), (&[9, 14, 8][..], &[20][..]));
        // Never beyond the gate: both extremes, in their order.
        assert_eq!(found(3, &[10, 11, 9]).1[..], [11, 9]);
        assert_eq!(found(3, &[10, 9, 11]).1[..], [9, 11]);
    }

    #[test]
    fn gates_outside_the_scale_are_refused() {
        assert_eq!(TurningPoints::try_new(0), Err(Error::OutOfRange("gate")));
        assert_eq!(TurningPoints::try_new(128), Err(Error::OutOfRange("gate")));
    }
}
