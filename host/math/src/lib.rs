//! Matrix equations and error metrics of the host, in f64.
#![forbid(unsafe_code)]

pub mod exponential;
pub mod metrics;
pub mod riccati;
