//! Defines what a model image states of one load (`LoadSignal`): name, full scale on the bus,
//! largest standard deviation of a valid estimate. Also the vector type of gearbox states.

use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Longest name of a machine or a load in an image (bytes).
pub const MAX_NAME: usize = 24;

/// Name, scale and limit of one load.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LoadSignal {
    /// Its name.
    pub name: heapless::String<MAX_NAME>,
    /// The load at the end of the scale on the bus [N m, N], > 0.
    pub full_scale: f32,
    /// A standard deviation above this makes the estimate not valid [N m, N], > 0.
    pub valid_std: f32,
}

/// Vectors over the states of a gearbox in an image: scale, rows, initial values.
pub type StateVec<T> = Vec<T, MAX_STATES>;

/// Most states that the model of a gearbox can have.
pub const MAX_STATES: usize = 16;
