//! Design of estimators: machine description to model image, calibration of bearings, and
//! finite-element strains to strain maps; list of its modules.
//!
//! [`build`] is the entry; one module for each machine kind has its mathematics.
//! [`reduce`] makes strain maps from a finite-element model.
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::unreachable,
        clippy::todo,
        clippy::unimplemented
    )
)]

pub mod bearing;
pub mod build;
mod drive;
mod encoder_scaling;
mod error;
pub mod gearbox;
mod payload;
pub mod reduce;
pub mod rotor;
mod sensor_set;
