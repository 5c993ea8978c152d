//! Computes strain maps of a gearbox's gauges over the carrier angle from finite-element strains
//! under unit loads, for `loadtwin reduce`. This file reads the nodes near the gauges with their
//! strains (`read_nodes`); the submodules have forces and superposition.
//!
//! The housing is linear and quasi-static: the strain of a gauge is the sum of
//! its strains under unit loads, each times the force that the equilibrium of
//! gears and bearings gives at that carrier angle.

mod csv_table;
mod equilibrium;
mod error;
mod frd;
mod load_cases;
mod strain_maps;

use std::path::Path;

pub use crate::reduce::equilibrium::{Contact, Force, HousingForces, axes};
pub use crate::reduce::error::ReduceError;
pub use crate::reduce::load_cases::{Axis, LoadCase, read_cases};
pub use crate::reduce::strain_maps::{GaugeMaps, Reduction};

use loadtwin_machine::Machine;
use loadtwin_recording::Unit;

/// A node of the finite-element model and its strain under each load case.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// Its number in the model.
    pub number: u64,
    /// Where it is (m).
    pub position_m: [f64; 3],
    /// Tensor strain for each load case: xx, yy, zz, xy, yz, zx.
    pub strains: Vec<[f64; 6]>,
}

impl Node {
    /// Strain along `direction` under load case `case`, `n' e n / n' n`.
    pub fn along(&self, direction: [f64; 3], case: usize) -> f64 {
        let [x, y, z] = direction;
        let [xx, yy, zz, xy, yz, zx] = self.strains[case];
        (x * x * xx + y * y * yy + z * z * zz + 2.0 * (x * y * xy + y * z * yz + z * x * zx))
            / (x * x + y * y + z * z)
    }
}

/// Reads the nodes near the machine's gauges from `strains`, a `CalculiX` `.frd`
/// file or a CSV table, one load case after the other.
///
/// `length`: unit of the coordinates in an `.frd` file, which does not say.
///
/// # Errors
/// When the file cannot be read, does not have `cases` load cases, or a strain is missing.
pub fn read_nodes(
    machine: &Machine,
    strains: &Path,
    cases: usize,
    length: Unit,
) -> Result<Vec<Node>, ReduceError> {
    let wanted = |position: [f64; 3]| {
        machine
            .channels
            .iter()
            .filter_map(|c| c.place.as_ref())
            .any(|place| distance(place.position_m, position) <= place.patch_m)
    };
    let is_frd = strains
        .extension()
        .is_some_and(|extension| extension.eq_ignore_ascii_case("frd"));
    if is_frd {
        frd::read(strains, cases, length, wanted)
    } else {
        csv_table::read(strains, cases, wanted)
    }
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
}
