//! Defines the innovation of a scalar measurement (value, variance, NIS, and whether it was used)
//! and the gate that rejects an innovation by its NIS (`Gate`). After a given number of rejections
//! in a row a gate can open again.

use serde::{Deserialize, Serialize};

use crate::error::Error;

/// What became of one channel in one update.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The channel corrected the posterior.
    Used,
    /// The innovation lay outside the gate; the posterior is untouched.
    Gated,
    /// The measurement was missing, or a number was NaN, infinite or outside
    /// the range of the filter; the posterior is untouched.
    Invalid,
}

/// Innovation of one channel: measurement minus prediction, and its variance.
///
/// In a sequence of channels each innovation is conditional on the channels
/// used before it, so that the sum of their NIS is the NIS of the whole sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Innovation {
    /// `nu = y - h(x)`, [measurement unit]; 0 when invalid.
    pub value: f32,
    /// `s = h P h' + r`, [measurement unit]^2; 0 when invalid.
    pub variance: f32,
    /// Normalised innovation squared `nu^2 / s`, chi-squared with one degree
    /// of freedom in a consistent filter; 0 when invalid.
    pub nis: f32,
    /// What the filter did with it.
    pub outcome: Outcome,
}

impl Innovation {
    /// The innovation of a channel that gave no usable number.
    pub const INVALID: Self = Self {
        value: 0.0,
        variance: 0.0,
        nis: 0.0,
        outcome: Outcome::Invalid,
    };

    /// Whether the channel corrected the posterior.
    pub fn used(&self) -> bool {
        self.outcome == Outcome::Used
    }
}

/// Gate of one channel: refuses innovations whose NIS exceeds a limit, but not
/// for ever.
///
/// After `patience` refusals in a row the filter, not the channel, is taken to
/// be wrong: the gate stays open until the NIS is back within the limit.
/// A channel that is at fault for longer has to be taken out by the diagnosis
/// of the channel, not by the gate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gate {
    limit: f32,
    patience: u16,
    refused: u16,
}

impl Gate {
    /// A gate that lets every finite innovation pass.
    pub const fn open() -> Self {
        Self {
            limit: f32::MAX,
            patience: u16::MAX,
            refused: 0,
        }
    }

    /// A gate that lets nothing pass: innovations are reported, the posterior stays.
    pub const fn closed() -> Self {
        Self {
            limit: -1.0,
            patience: u16::MAX,
            refused: 0,
        }
    }

    /// Gate at a NIS of `limit` (chi-squared, one degree of freedom: 10.83 is
    /// exceeded by one sound sample in a thousand), open again after
    /// `patience` refusals in a row; `u16::MAX`: never.
    ///
    /// # Errors
    /// `NotPositive("gate")` when the limit is not above zero.
    pub const fn try_new(limit: f32, patience: u16) -> Result<Self, Error> {
        if limit > 0.0 {
            Ok(Self {
                limit,
                patience,
                refused: 0,
            })
        } else {
            Err(Error::NotPositive("gate"))
        }
    }

    /// Whether one finite NIS passes; counts the refusals in a row.
    #[inline]
    pub fn accepts(&mut self, nis: f32) -> bool {
        let within = nis <= self.limit;
        if within {
            self.refused = 0;
        }
        within || self.reopens()
    }

    /// Whether an innovation outside the limit passes because the patience
    /// has run out.
    #[cold]
    fn reopens(&mut self) -> bool {
        if self.is_exhausted() {
            return true;
        }
        self.refused = self.refused.saturating_add(1);
        false
    }

    /// Whether the patience has run out: what contradicts next is admitted.
    pub fn is_exhausted(&self) -> bool {
        self.refused >= self.patience && self.patience != u16::MAX
    }

    /// Refusals in a row up to now.
    pub fn rejections(&self) -> u16 {
        self.refused
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gate_opens_after_its_patience_and_closes_when_the_filter_has_caught_up() {
        let mut gate = Gate::try_new(9.0, 3).unwrap();
        let accepted = [100.0, 100.0, 100.0, 100.0, 50.0, 8.0, 10.0].map(|nis| gate.accepts(nis));
        assert_eq!(accepted, [false, false, false, true, true, true, false]);
        assert_eq!((gate.rejections(), gate.is_exhausted()), (1, false));
        gate.accepts(10.0);
        gate.accepts(10.0);
        assert!(gate.is_exhausted());
    }

    #[test]
    fn a_gate_without_patience_stays_shut() {
        let mut gate = Gate::try_new(9.0, u16::MAX).unwrap();
        assert!((0..200_000).all(|_| !gate.accepts(10.0) && !gate.is_exhausted()));
        assert!(Gate::open().accepts(1e30));
        assert_eq!(Gate::try_new(f32::NAN, 1), Err(Error::NotPositive("gate")));
    }
}
