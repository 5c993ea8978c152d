//! Counts closed rainflow cycles by the bins of their lower and upper level, 64 of each
//! (`CycleMatrix`); the counts can be read by range and mean as well. A cell has 32 bits; a list of
//! 40 carries keeps the counts exact for 3.4e11 samples.

use heapless::Vec;
use serde::{Deserialize, Serialize};

use super::four_point_rainflow::Cycle;
use super::long_array_serde;
use super::{BINS, bin};

/// Pairs of a lower and a higher bin.
pub(super) const CELLS: usize = BINS * (BINS - 1) / 2;

/// Most cells that may have a carry.
///
/// 40 carries are `40 * 2^32` cycles, of two samples at least: 3.4e11 samples, 21 years at 500 Hz.
const CARRIES: usize = 40;

/// Cycles by the bins of their lower and upper level, [`BINS`] of each.
///
/// The same cells are the range-mean matrix: range and mean in bins are
/// `high - low` and `(low + high) / 2`, and the pair determines both. Only pairs
/// with `low < high` are stored, 2016 of 4096. A cycle inside one bin (range 1
/// level) is in no cell; it crosses no edge of a bin and has its place among the ranges.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CycleMatrix {
    #[serde(with = "long_array_serde")]
    low: [u32; CELLS],
    carries: Vec<Carry, CARRIES>,
    lost: u64,
}

/// How often a cell passed 2^32.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
struct Carry {
    cell: u16,
    count: u16,
}

/// Cell of the bins `low < high`.
fn cell(low: usize, high: usize) -> usize {
    high * (high.saturating_sub(1)) / 2 + low
}

impl CycleMatrix {
    /// No cycles yet.
    pub const fn new() -> Self {
        Self {
            low: [0; CELLS],
            carries: Vec::new(),
            lost: 0,
        }
    }

    /// Counts a cycle.
    #[inline]
    pub fn add(&mut self, cycle: Cycle) {
        let (low, high) = (bin(cycle.low, BINS), bin(cycle.high, BINS));
        if low < high
            && let Some(count) = self.low.get_mut(cell(low, high))
            && let Some(sum) = count.checked_add(1)
        {
            *count = sum;
        } else {
            self.add_to(low, high, 1);
        }
    }

    /// Counts `count` cycles between the bins `low < high`; none for others.
    #[inline(never)]
    fn add_to(&mut self, low: usize, high: usize, count: u64) {
        if low >= high || high >= BINS {
            return;
        }
        self.add_at(cell(low, high), count);
    }

    /// Counts `count` cycles in a cell, below [`CELLS`].
    pub(super) fn add_at(&mut self, cell: usize, count: u64) {
        let Some(low) = self.low.get_mut(cell) else {
            return;
        };
        let sum = u64::from(*low) + (count & u64::from(u32::MAX));
        let carry = (sum >> 32) + (count >> 32);
        *low = sum as u32;
        if carry > 0 && !self.carry(cell as u16, carry) {
            self.lost = self.lost.saturating_add(carry << 32);
        }
    }

    /// Adds to the carry of a cell; false where there is no place for it.
    fn carry(&mut self, cell: u16, count: u64) -> bool {
        let Ok(count) = u16::try_from(count) else {
            return false;
        };
        match self.carries.iter_mut().find(|carry| carry.cell == cell) {
            Some(carry) => match carry.count.checked_add(count) {
                Some(sum) => {
                    carry.count = sum;
                    true
                }
                None => false,
            },
            None => self.carries.push(Carry { cell, count }).is_ok(),
        }
    }

    /// Cycles between two bins; zero where not `low < high < BINS`.
    pub fn get(&self, low: usize, high: usize) -> u64 {
        if low >= high || high >= BINS {
            return 0;
        }
        self.at(cell(low, high))
    }

    /// Cycles in a cell, below [`CELLS`].
    pub(super) fn at(&self, cell: usize) -> u64 {
        let carry = (self.carries.iter()).find(|carry| usize::from(carry.cell) == cell);
        let low = self.low.get(cell).copied().unwrap_or(0);
        carry.map_or(0, |carry| u64::from(carry.count) << 32) + u64::from(low)
    }

    /// Cycles of a range and a mean, in bins, of the 64 x 64 matrix; zero for a pair that no
    /// cycle can have.
    pub fn range_mean(&self, range: usize, mean: usize) -> u64 {
        // floor((low + high) / 2) = mean, and high - low = range.
        match mean.checked_sub(range / 2) {
            Some(low) => self.get(low, low + range),
            None => 0,
        }
    }

    /// Cells with cycles: lower bin, upper bin, cycles.
    pub fn cells(&self) -> impl Iterator<Item = (usize, usize, u64)> {
        let pairs = (1..BINS).flat_map(|high| (0..high).map(move |low| (low, high)));
        pairs
            .map(|(low, high)| (low, high, self.get(low, high)))
            .filter(|cell| cell.2 > 0)
    }

    /// Adds to the cycles that found no place for their carry.
    pub(super) fn lose(&mut self, count: u64) {
        self.lost = self.lost.saturating_add(count);
    }

    /// Cycles that found no place for their carry: 0 within 3.4e11 samples.
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// Adds each cell of another one.
    pub fn add_all(&mut self, other: &Self) {
        for (low, high, count) in other.cells() {
            self.add_to(low, high, count);
        }
        self.lost = self.lost.saturating_add(other.lost);
    }

    /// Whether the carries belong to cells, each at most once; for a matrix read from bytes.
    pub(super) fn is_valid(&self) -> bool {
        let cells = self.carries.iter().map(|carry| carry.cell);
        self.carries.iter().enumerate().all(|(i, carry)| {
            usize::from(carry.cell) < CELLS
                && carry.count > 0
                && cells.clone().skip(i + 1).all(|other| other != carry.cell)
        })
    }
}

impl Default for CycleMatrix {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_pair_has_a_cell_of_its_own_in_both_forms() {
        let mut matrix = CycleMatrix::new();
        let mut expected = 0;
        for high in 1..BINS {
            for low in 0..high {
                expected += 1;
                matrix.add_to(low, high, expected);
            }
        }
        assert_eq!(expected, CELLS as u64);
        let mut count = 0;
        for (low, high, cycles) in matrix.cells() {
            count += 1;
            assert_eq!(cycles, count);
            assert_eq!(
                matrix.range_mean(high - low, usize::midpoint(low, high)),
                cycles
            );
        }
        let by_range_and_mean: u64 = (0..BINS)
            .flat_map(|range| (0..BINS).map(move |mean| (range, mean)))
            .map(|(range, mean)| matrix.range_mean(range, mean))
            .sum();
        assert_eq!(by_range_and_mean, expected * (expected + 1) / 2);
    }

    /// 1e9 samples and 20 years at 500 Hz, by adding large counts to the smallest cell.
    #[test]
    fn carries_are_exact_for_twenty_years() {
        let samples = 20 * 365 * 86_400 * 500_u64;
        let mut matrix = CycleMatrix::new();
        let cycle = Cycle { low: 63, high: 65 };
        matrix.add_to(31, 32, u64::from(u32::MAX));
        matrix.add(cycle);
        assert_eq!(matrix.get(31, 32), 1 << 32);
        matrix.add_to(31, 32, samples / 2 - (1 << 32) - 1);
        matrix.add(cycle);
        assert_eq!((matrix.get(31, 32), matrix.lost()), (samples / 2, 0));
        // As many cells as there can be carries in that time.
        let mut matrix = CycleMatrix::new();
        for high in 1..=CARRIES {
            matrix.add_to(0, high, (1 << 32) + 5);
        }
        assert!(matrix.cells().all(|(.., count)| count == (1 << 32) + 5));
        assert!(matrix.is_valid() && matrix.lost() == 0);
        matrix.add_to(0, 63, 1 << 32);
        assert_eq!((matrix.get(0, 63), matrix.lost()), (0, 1 << 32));
    }
}
