//! Counts load cycles (rainflow), time at level and revolutions at load, sample by sample, in
//! bounded memory for years of operation; `LoadCounts` is the counter of one load. This file has
//! the numbers of levels and bins, and the list of modules.
//!
//! ```text
//! load [N m, N] -> level 0..128 -> turning points (hysteresis gate) -> four-point rainflow -> counts
//!                      |-> time at level, turns at level, extremes
//! ```
//!
//! A load is first brought onto [`LEVELS`] levels of equal width. All that
//! follows is integer arithmetic: the counts of a sequence are the same however
//! it is cut, saved and continued, and the residue has at most
//! [`four_point_rainflow::MAX_POINTS`] points for any input.
//!
//! Source: ASTM E1049-85 (2017), 5.4.4; Amzallag, Gerey, Robert, Bahuaud,
//! Standardization of the rainflow counting method for fatigue analysis, 1994
//! (four-point); DIN 45667 (level crossing, time at level).

pub mod count_increment;
pub mod counted_load;
pub mod coverage;
pub mod cycle_matrix;
pub mod four_point_rainflow;
pub mod kept;
pub mod load_counts;
pub mod load_revolutions;
mod long_array_serde;
pub mod machine_counts;
pub mod saved_counts;
pub mod scale;
pub mod tally_array;
pub mod turning_points;

#[cfg(test)]
mod tests;

pub use count_increment::{ByteSink, ByteSource};
pub use counted_load::{CountSample, CountedLoad, CountedLoads, LoadSampler, MAX_COUNTED};
pub use coverage::Observation;
pub use cycle_matrix::CycleMatrix;
pub use four_point_rainflow::{Cycle, Residue};
pub use load_counts::LoadCounts;
pub use load_revolutions::Turns;
pub use machine_counts::MachineCounts;
pub use scale::LevelScale;
pub use turning_points::TurningPoints;

/// Levels that a load is brought onto.
///
/// Rounding to a level changes a range by a triangular error of variance
/// 1/6 level^2: a cycle over a tenth of the scale is counted with a damage that
/// is 0.3 % too high for exponent 3 and 3.7 % for exponent 9 in the mean.
pub const LEVELS: usize = 128;

/// Gate where none is given (levels): one bin of the matrix, so that a load between two levels
/// makes no cycles.
pub const GATE_LEVELS: u8 = 2;

/// Bins of matrix, level crossings and time at level; two levels each.
pub const BINS: usize = 64;

/// Bins of the load-revolution distribution; four levels each.
pub const TURN_BINS: usize = 32;

/// Shafts whose turns are counted: of the load's own shaft, and of the carrier or another one.
pub const SHAFTS: usize = 2;

/// Bin of a level in a division into `bins`.
pub(crate) fn bin(level: u8, bins: usize) -> usize {
    usize::from(level) * bins / LEVELS
}

// A level fits u8, and bins are whole levels.
const _: () =
    assert!(LEVELS <= 256 && LEVELS.is_multiple_of(BINS) && LEVELS.is_multiple_of(TURN_BINS));
