//! Design-time mathematics, recordings, replay, reports and CAN on the host.
#![forbid(unsafe_code)]

pub mod metrics;
pub mod recording;
pub mod strain;
