//! Fits to recordings: gauge sensitivities ([`calibrate`]), noise ([`tune`], [`rotor_tune`]) and
//! the error of the loads ([`error_band`]).
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

pub mod calibrate;
pub mod error_band;
pub mod rotor_tune;
pub mod tune;
