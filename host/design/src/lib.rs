//! Designs estimators: computes the model image that the microcontroller runs from a machine
//! description, calibrates bearings, and reduces finite-element strains to strain maps. This file
//! only lists the modules.
//!
//! [`image_build`] is the entry; one module for each machine kind has its mathematics.
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
mod drive;
mod encoder_scaling;
mod error;
pub mod gearbox;
pub mod image_build;
mod payload;
pub mod reduce;
pub mod rotor;
mod sensor_set;
