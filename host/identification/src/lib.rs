//! What is fitted to recordings: gauge sensitivities ([`calibrate`]) and noise ([`tune`],
//! [`rotor_tune`]).
#![forbid(unsafe_code)]

pub mod calibrate;
pub mod rotor_tune;
pub mod tune;
