//! Holds the coverage of the counts of a load (`Observation`): numbers of valid, invalid, missing
//! and out-of-scale samples, of gaps and of restarts; computes the share of the time with a valid
//! load.

use serde::{Deserialize, Serialize};

/// Samples by what they were, and interruptions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Observation {
    /// Samples with a valid load.
    pub seen: u64,
    /// Samples without a valid load.
    pub not_valid: u64,
    /// Samples that were never taken, in gaps.
    pub missing: u64,
    /// Valid samples beyond the scale, counted at its nearer end.
    pub beyond: u64,
    /// Gaps.
    pub gaps: u32,
    /// Restarts; the time without power is not known.
    pub restarts: u32,
}

impl Observation {
    /// Samples of the whole time since counting began.
    pub fn elapsed(&self) -> u64 {
        self.seen
            .saturating_add(self.not_valid)
            .saturating_add(self.missing)
    }

    /// Part of the time that was seen, 0 to 1; none before the first sample.
    pub fn share(&self) -> Option<f64> {
        let elapsed = self.elapsed();
        (elapsed > 0).then(|| self.seen as f64 / elapsed as f64)
    }

    /// Adds another one.
    pub fn add_all(&mut self, other: &Self) {
        let wide = |a: &mut u64, b: u64| *a = a.saturating_add(b);
        wide(&mut self.seen, other.seen);
        wide(&mut self.not_valid, other.not_valid);
        wide(&mut self.missing, other.missing);
        wide(&mut self.beyond, other.beyond);
        self.gaps = self.gaps.saturating_add(other.gaps);
        self.restarts = self.restarts.saturating_add(other.restarts);
    }
}
