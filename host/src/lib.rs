//! Design-time mathematics, recordings, replay, reports and CAN on the host.
#![forbid(unsafe_code)]

pub mod atomic_file;
pub mod balance;
pub mod build;
pub mod calibrate;
pub mod can;
pub mod cli;
pub mod diagnose;
pub mod exponential;
pub mod gearbox;
pub mod key;
pub mod machine;
pub mod metrics;
pub mod recording;
pub mod reduce;
pub mod replay;
pub mod report;
pub mod riccati;
pub mod seal;
pub mod simulate;
pub mod strain;
pub mod tables;
pub mod tune;
pub mod upload;
