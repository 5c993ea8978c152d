//! From raw counts to CAN payload bytes, bit for bit the same on the
//! microcontroller and on the host.
#![no_std]
#![forbid(unsafe_code)]

pub mod bearing;
pub mod butterworth;
pub mod elementary;
pub mod error;
pub mod estimate;
pub mod fault;
pub mod frame;
pub mod gaussian;
pub mod gearbox;
pub mod image;
pub mod innovation;
pub mod isotp;
pub mod kalman;
pub mod line;
pub mod measurement;
pub mod phase;
pub mod raw;
pub mod rotor;
pub mod scheduled_gain;
pub mod sealed;
pub mod table;
pub mod transition;
pub mod uds;
mod unroll;
pub mod unscented;

pub use error::Error;
