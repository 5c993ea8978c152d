//! The rotor at design time: finite elements, modes, responses, reduction.

mod convergence;
mod discrete;
mod driven;
mod eigenpairs;
mod element;
mod image;
mod inversion;
mod model;
mod modes;
mod plan;
mod reduction;
mod response;
mod stability;
mod truncation;
mod unbalance;

use thiserror::Error;

pub use discrete::{Discrete, discrete, moved, turned};
pub use driven::{DrivenRotor, Turning, TurningForce};
pub use element::{ElementMatrix, NODE, PartMatrices, ShaftElement};

pub use inversion::PhasorInversion;
pub use model::RotorModel;
pub use modes::{Mode, UndampedModes, campbell, modes, undamped_modes};
pub use plan::RotorPlan;
pub use reduction::{Reduced, ReductionError};
pub use response::TimeResponse;
pub use stability::Instability;
pub use unbalance::{Unbalance, unbalance_response};

/// Why a rotor cannot be computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum RotorError {
    /// The bearings do not hold the rotor.
    #[error("the stiffness matrix is singular: the bearings do not hold the rotor")]
    NotHeld,
    /// An eigenvalue problem has no solution in floating point.
    #[error("the eigenvalues cannot be computed: a stiffness or mass is out of all proportion")]
    NoEigenvalues,
    /// Undamped and driven exactly at resonance.
    #[error("the response is infinite: an undamped rotor at its critical speed")]
    Resonance,
}
