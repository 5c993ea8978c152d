//! Estimates the loads of rotating machines by Kalman filters, from raw converter words and encoder
//! counts to CAN payload bytes, bit for bit the same on the microcontroller and on the host;
//! `estimator::Estimator` is the entry point.
#![no_std]
#![forbid(unsafe_code)]

pub mod bearing;
pub mod counting;
pub mod drive;
pub mod drivetrain;
pub mod error;
pub mod estimator;
pub mod hardware;
pub mod image;
pub mod io;
pub mod kalman;
pub mod load_signal;
mod matrix_serde;
pub mod rotor;
mod saved_bytes;
pub mod signal;

pub use crate::error::Error;
