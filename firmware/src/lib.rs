//! The loadtwin estimator on a microcontroller.
//!
//! [`app`] is what every board runs, over the one trait [`board::Board`]; the
//! boards are the binaries of this package, one feature each.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
#[macro_use]
extern crate std;

pub mod app;
pub mod board;
pub mod campaign;
pub mod counters;
pub mod counting;
pub mod driver;
pub mod model;
pub mod owned;
pub mod progress;
pub mod ram_flash;
pub mod simulated_flash;
pub mod slcan;
pub mod stimulus;
pub mod store;
pub mod upload;
