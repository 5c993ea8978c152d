//! Counts the revolutions of a shaft by the load at which they were made (load-revolution
//! distribution, `Turns`), in parts of 1/32 revolution; those without a valid load are counted
//! apart.

use serde::{Deserialize, Serialize};

use super::tally_array::Tally;
use super::{TURN_BINS, bin};

/// log2 of the parts of a turn that are counted, 1/32 turn: in 40 bits 3.4e10 turns, 43 years at
/// 1500 rpm.
const PARTS_LOG2: u32 = 5;

/// Bits of an advance, in 2^-32 turn, below a counted part.
const BELOW: u32 = 32 - PARTS_LOG2;

/// Those bits.
const MASK: u32 = (1 << BELOW) - 1;

/// Index of turns without a valid load.
const UNSEEN: usize = TURN_BINS;

/// Counters of a shaft: those of the bins, and without a valid load.
pub(super) const COUNTERS: usize = TURN_BINS + 1;

/// Turns of a shaft by the load that they were made at.
///
/// Both directions of rotation count. The part that is counted is that of the
/// sample which completes it; what is below a part is carried, so that the sum is exact.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Turns {
    pub(super) parts: Tally<COUNTERS>,
    /// Below a part [2^-32 turn].
    pub(super) below: u32,
}

impl Turns {
    /// No turns yet.
    pub const fn new() -> Self {
        Self {
            parts: Tally::new(),
            below: 0,
        }
    }

    /// Counts an advance [2^-32 turn] at a level, or without a valid load.
    #[inline]
    pub fn add(&mut self, level: Option<u8>, advance: u32) {
        // Below 2^28: both are below a part.
        let below = self.below + (advance & MASK);
        self.below = below & MASK;
        let parts = (advance >> BELOW) + (below >> BELOW);
        if parts > 0 {
            let index = level.map_or(UNSEEN, |level| bin(level, TURN_BINS));
            self.parts.add(index, parts.into());
        }
    }

    /// Turns at the loads of a bin.
    pub fn turns(&self, bin: usize) -> f64 {
        if bin < TURN_BINS {
            to_turns(self.parts.get(bin))
        } else {
            0.0
        }
    }

    /// Turns without a valid load.
    pub fn unseen(&self) -> f64 {
        to_turns(self.parts.get(UNSEEN))
    }

    /// Adds those of another one.
    pub fn add_all(&mut self, other: &Self) {
        self.parts.add_all(&other.parts);
        let sum = self.below + other.below;
        self.below = sum & MASK;
        self.parts.add(UNSEEN, u64::from(sum >> BELOW));
    }

    /// Whether the state is one that a sequence can lead to, after it came from bytes.
    pub(super) fn is_valid(&self) -> bool {
        self.below <= MASK
    }
}

fn to_turns(parts: u64) -> f64 {
    parts as f64 / f64::from(1 << PARTS_LOG2)
}

impl Default for Turns {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thousand_turns_of_odd_steps_lose_nothing() {
        let mut turns = Turns::new();
        let step = 0x0123_4567;
        let steps = 1_000_000_u64;
        for i in 0..steps {
            turns.add((i % 5 != 0).then_some((i % 128) as u8), step);
        }
        let counted: f64 = (0..TURN_BINS).map(|bin| turns.turns(bin)).sum();
        let expected = steps as f64 * f64::from(step) / 4_294_967_296.0;
        assert!((0.0..1.0 / 32.0).contains(&(expected - counted - turns.unseen())));
        assert!((turns.unseen() / expected - 0.2).abs() < 0.02);
    }
}
