//! The loadtwin estimator on a microcontroller.
#![no_std]
#![forbid(unsafe_code)]

pub mod simulated_flash;
pub mod store;
pub mod upload;
