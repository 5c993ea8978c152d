//! Measures the instructions for a step of other Kalman filters on the same system: dense textbook
//! products with nalgebra, and minikalman.

use core::hint::black_box;

use minikalman::prelude::*;
use minikalman::regular::builder::KalmanFilterBuilder;
use nalgebra::{SMatrix, SVector};

use super::{channel, report, samples, system};

/// The textbook extended filter with nalgebra's dense products, all channels
/// at once: the peer that a first version would be.
pub fn naive<const NX: usize, const NY: usize>(name: &str) {
    let f = black_box(system::<NX>());
    let q = black_box(SMatrix::<f32, NX, NX>::from_diagonal_element(1e-3));
    let h = black_box(SMatrix::<f32, NY, NX>::from_fn(|i, j| channel::<NX>(i)[j]));
    let r = black_box(SMatrix::<f32, NY, NY>::from_diagonal_element(0.01));
    let samples = black_box(samples::<NY>());
    let mut x = SVector::<f32, NX>::zeros();
    let mut p = SMatrix::<f32, NX, NX>::identity();
    report(name, |k| {
        x = f * x;
        p = f * p * f.transpose() + q;
        let nu = SVector::from(samples[k as usize % 16]) - h * x;
        let s = h * p * h.transpose() + r;
        if let Some(inverse) = s.try_inverse() {
            let gain = p * h.transpose() * inverse;
            x += gain * nu;
            p = (SMatrix::<f32, NX, NX>::identity() - gain * h) * p;
        }
    });
    black_box((x, p));
}

/// By minikalman; its builder needs a heap.
pub fn minikalman<const NX: usize, const NY: usize>(name: &str) {
    let f = system::<NX>();
    let builder = KalmanFilterBuilder::<NX, f32>::default();
    let mut filter = builder.build();
    let mut measurement = builder.observations().build::<NY>();
    filter
        .state_transition_mut()
        .apply(|a| fill::<NX, NX>(a, |i, j| f[(i, j)]));
    filter.estimate_covariance_mut().make_identity();
    filter.direct_process_noise_mut().make_scalar(1e-3);
    measurement
        .observation_matrix_mut()
        .apply(|h| fill::<NY, NX>(h, |i, j| channel::<NX>(i)[j]));
    measurement
        .measurement_noise_covariance_mut()
        .make_scalar(0.01);
    let samples = black_box(samples::<NY>());
    report(name, |k| {
        let y = &samples[k as usize % 16];
        measurement.measurement_vector_mut().apply(|z| {
            for i in 0..NY {
                z[i] = y[i];
            }
        });
        filter.predict();
        filter.correct(&mut measurement);
    });
}

/// Fills a row-major matrix.
fn fill<const ROWS: usize, const COLUMNS: usize>(
    matrix: &mut impl core::ops::IndexMut<usize, Output = f32>,
    entry: impl Fn(usize, usize) -> f32,
) {
    for i in 0..ROWS {
        for j in 0..COLUMNS {
            matrix[i * COLUMNS + j] = entry(i, j);
        }
    }
}
