//! Identification from recordings: gauge sensitivities and noise of a drivetrain ([`calibrate`]),
//! noise of its filter ([`tune`]) and of a rotor's ([`rotor_tune`]), error of the loads
//! ([`error_band`]); characteristics of bridges and load cells from loads at rest
//! ([`static_calibration`]).
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
pub mod static_calibration;
pub mod tune;
