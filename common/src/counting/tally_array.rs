//! Counts events by index in an array of 40-bit counters that stay at their largest count
//! (`Tally`): 32 low bits and a carry of 8 bits each, which saves memory against 64 bits.

use serde::{Deserialize, Serialize};

use super::long_array_serde;

/// Largest count: at 500 Hz, a sample is counted for 69 years.
const LARGEST: u64 = (1 << 40) - 1;

/// `N` counters of 40 bits, the low 32 and a carry of 8; a count stays at the largest number.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Tally<const N: usize> {
    #[serde(with = "long_array_serde")]
    low: [u32; N],
    #[serde(with = "long_array_serde")]
    carry: [u8; N],
}

impl<const N: usize> Tally<N> {
    /// All zero.
    pub const fn new() -> Self {
        Self {
            low: [0; N],
            carry: [0; N],
        }
    }

    /// Adds to a counter; nothing for one that is not there.
    #[inline]
    pub fn add(&mut self, index: usize, count: u64) {
        if let Some(low) = self.low.get_mut(index)
            && let Ok(count) = u32::try_from(count)
            && let Some(sum) = low.checked_add(count)
        {
            *low = sum;
        } else {
            self.add_with_carry(index, count);
        }
    }

    /// As [`Self::add`], for a count that carries: once in 2^32 samples.
    #[cold]
    #[inline(never)]
    fn add_with_carry(&mut self, index: usize, count: u64) {
        if let (Some(low), Some(carry)) = (self.low.get_mut(index), self.carry.get_mut(index)) {
            let sum = (u64::from(*carry) << 32 | u64::from(*low)).saturating_add(count);
            let sum = sum.min(LARGEST);
            *low = sum as u32;
            *carry = (sum >> 32) as u8;
        }
    }

    /// A count; zero for one that is not there.
    pub fn get(&self, index: usize) -> u64 {
        match (self.low.get(index), self.carry.get(index)) {
            (Some(&low), Some(&carry)) => u64::from(carry) << 32 | u64::from(low),
            _ => 0,
        }
    }

    /// All counts.
    pub fn iter(&self) -> impl Iterator<Item = u64> {
        (0..N).map(|i| self.get(i))
    }

    /// Adds each counter of another one.
    pub fn add_all(&mut self, other: &Self) {
        for i in 0..N {
            self.add(i, other.get(i));
        }
    }
}

impl<const N: usize> Default for Tally<N> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn carries_and_stays_at_its_largest_number() {
        let mut tally = Tally::<2>::new();
        tally.add(1, u64::from(u32::MAX));
        tally.add(1, 1);
        assert_eq!((tally.get(0), tally.get(1)), (0, 1 << 32));
        tally.add(1, LARGEST - (1 << 32) - 1);
        assert_eq!(tally.get(1), LARGEST - 1);
        for _ in 0..3 {
            tally.add(1, 1);
            assert_eq!(tally.get(1), LARGEST);
        }
        tally.add(1, u64::MAX);
        tally.add(2, 1);
        assert_eq!((tally.get(1), tally.get(2)), (LARGEST, 0));
    }
}
