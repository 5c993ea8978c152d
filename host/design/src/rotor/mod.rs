//! Estimator design for a rotor: finite-element model, modes, responses, model reduction, filter
//! and model image. This file lists the modules and defines their error type, `RotorError`.

mod beam_element;
mod discretisation;
mod displacement_deviation;
mod eigenpairs;
mod fe_model;
mod filter_design;
mod forced_simulation;
mod gain_convergence;
mod harmonic_response;
mod modal_truncation;
mod model_image;
mod modes;
mod phasor_inversion;
mod stability;
mod time_response;
mod tolerance_covariance;
mod undamped_mode_reduction;

use thiserror::Error;

pub use crate::rotor::beam_element::{ElementMatrices, ElementMatrix, NODE, ShaftElement};
pub use crate::rotor::discretisation::{DiscreteModel, discrete, force_rotation, force_transition};
pub use crate::rotor::forced_simulation::{ForcedRotor, ShaftRotation, SynchronousForce};

pub use crate::rotor::displacement_deviation::{NodeDeviations, Uncertainty};
pub use crate::rotor::fe_model::RotorModel;
pub use crate::rotor::filter_design::RotorFilterDesign;
pub use crate::rotor::harmonic_response::{Unbalance, unbalance_response};
pub use crate::rotor::modes::{Mode, UndampedModes, campbell, modes, undamped_modes};
pub use crate::rotor::phasor_inversion::PhasorInversion;
pub use crate::rotor::stability::Instability;
pub use crate::rotor::time_response::TimeResponse;
pub use crate::rotor::undamped_mode_reduction::{Reduced, ReductionError};

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
