//! The loadtwin estimator on a microcontroller: application, store of model images in flash,
//! upload, drivers, fault-injection campaign.
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
pub mod board_counters;
pub mod campaign;
pub mod counting;
pub mod counting_test;
pub mod counts;
pub mod driver;
pub mod interrupt_owned;
pub mod progress_check;
pub mod ram_flash;
pub mod raw_burst;
pub mod room;
pub mod running_model;
pub mod simulated_flash;
pub mod slcan;
pub mod stimulus;
pub mod store;
pub mod upload;
