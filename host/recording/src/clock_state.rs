//! Stores a recording's clock after its last row (`Clock`: sampling grid, time of that row in s),
//! serializable, so that the next file of the same recording is read on the same ticks.

use serde::{Deserialize, Serialize};

use super::sampling_grid::Grid;

/// Where the ticks of a recording are after its last row, so that another file goes on from it.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Clock {
    grid: Grid,
    last_t: f64,
}

impl Clock {
    pub(super) fn new(grid: Grid, last_t: f64) -> Self {
        Self { grid, last_t }
    }

    /// Time of the last row (s).
    pub(super) fn last_t(&self) -> f64 {
        self.last_t
    }

    pub(super) fn into_grid(self) -> Grid {
        self.grid
    }
}
