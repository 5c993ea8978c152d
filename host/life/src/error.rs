//! Error type of the life computation: numbers out of range, unusable S-N curves, counts of
//! different scales, and loads beyond the scale; the check for positive numbers.

use thiserror::Error;

/// Why a life cannot be computed; one line.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum LifeError {
    /// A number outside its range.
    #[error("{what} {found}: allowed: {allowed}")]
    Number {
        /// Which number.
        what: &'static str,
        /// What it is.
        found: f64,
        /// What it may be.
        allowed: &'static str,
    },
    /// An S-N curve of fewer than two points.
    #[error("S-N curve of {0} points: allowed: at least 2, each CYCLES:RANGE")]
    FewPoints(usize),
    /// An S-N curve that does not fall.
    #[error(
        "S-N curve: {cycles:e} cycles at range {range} after {cycles_before:e} cycles at range \
         {range_before}: allowed: points by increasing cycles, with falling range; exchange or correct them"
    )]
    Rises {
        /// Cycles of the point before.
        cycles_before: f64,
        /// Range of the point before.
        range_before: f64,
        /// Cycles of the point.
        cycles: f64,
        /// Range of the point.
        range: f64,
    },
    /// Counts of different scales.
    #[error(
        "scale of {name} is {found}, and {expected} in the counts before: counts of different scales \
         cannot be merged; count again with the same range and gate"
    )]
    Scale {
        /// Whose counts.
        name: String,
        /// Its scale.
        found: String,
        /// The scale of the others.
        expected: String,
    },
    /// Loads beyond the scale.
    #[error(
        "{name} reaches from {lowest} to {highest}, beyond its range {from} to {to} in {samples} samples: \
         give a range that covers it"
    )]
    Beyond {
        /// Whose counts.
        name: String,
        /// Lowest load.
        lowest: f32,
        /// Highest load.
        highest: f32,
        /// Lower end of the scale.
        from: f32,
        /// Upper end of the scale.
        to: f32,
        /// Samples beyond.
        samples: u64,
    },
}

/// A number that is positive and finite.
pub(crate) fn positive(what: &'static str, found: f64) -> Result<f64, LifeError> {
    if found > 0.0 && found.is_finite() {
        Ok(found)
    } else {
        Err(LifeError::Number {
            what,
            found,
            allowed: "above 0",
        })
    }
}
