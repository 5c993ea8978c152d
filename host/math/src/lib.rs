//! Numerical methods of the host in f64: matrix exponential, Riccati equation, unwrapping of
//! counters, and metrics of estimates.
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

pub mod count_unwrapping;
pub mod exponential;
pub mod metrics;
pub mod riccati;
