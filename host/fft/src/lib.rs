//! Plans Fourier transforms in f64.
//!
//! A crate of its own: the transforms are generic code, of which every crate that plans one compiles
//! its own copy, 25 s of processor time and 600 kB.
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

use std::sync::Arc;

use rustfft::FftPlanner;

pub use rustfft::Fft;
pub use rustfft::num_complex::Complex;

/// The transform `X_k = sum x_i exp(-2 pi j i k / n)` of `n` values, in place.
pub fn forward(n: usize) -> Arc<dyn Fft<f64>> {
    FftPlanner::new().plan_fft_forward(n)
}

/// The transform `x_i = sum X_k exp(2 pi j i k / n)` of `n` values, in place; `n` times the inverse
/// of [`forward`].
pub fn inverse(n: usize) -> Arc<dyn Fft<f64>> {
    FftPlanner::new().plan_fft_inverse(n)
}
