//! Measures the time of one filter step on the host, prediction and update by all channels: Kalman
//! filter of 4 to 12 states and 1 to 4 channels, unscented filter of 5 states and 8 channels.
//!
//! `cargo bench -p loadtwin-common --bench step`; the full filter with 6
//! states and 4 channels is to stay below 500 ns (2 million samples a second).

use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use loadtwin_common::kalman::gaussian::Gaussian;
use loadtwin_common::kalman::innovation::Gate;
use loadtwin_common::kalman::transition::{ProcessNoise, RandomWalk, Transition};
use loadtwin_common::kalman::unscented::Unscented;
use loadtwin_common::kalman::{predict, predict_constant, update};
use nalgebra::{RowSVector, SMatrix, SVector};

fn kalman<const NX: usize, const NY: usize>(criterion: &mut Criterion) {
    let f = SMatrix::from_fn(|i, j| match i {
        _ if i == j => {
            if i < NX - 2 {
                0.9
            } else {
                1.0
            }
        }
        _ if i < NX - 2 => 0.02 / (1.0 + i.abs_diff(j) as f32),
        _ => 0.0,
    });
    let transition = Transition::<NX, 2>::try_new(&f, RandomWalk).unwrap();
    let noise = ProcessNoise::independent(&SVector::repeat(1e-3)).unwrap();
    let rows: [RowSVector<f32, NX>; NY] =
        std::array::from_fn(|i| RowSVector::from_fn(|_, j| 1.0 / (1 + i + 2 * j) as f32));
    let mut posterior = Gaussian::independent(SVector::zeros(), &SVector::repeat(1.0)).unwrap();
    let mut gates = [Gate::open(); NY];
    criterion.bench_function(&format!("kalman {NX} states, {NY} channels"), |bench| {
        bench.iter(|| {
            predict(&mut posterior, black_box(&transition), black_box(&noise));
            for i in 0..NY {
                let nu = black_box(0.1) - (rows[i] * posterior.state)[0];
                black_box(update(&mut posterior, &rows[i], nu, 0.01, &mut gates[i]));
            }
        });
    });
}

fn unscented(criterion: &mut Criterion) {
    let rows: [RowSVector<f32, 5>; 8] =
        std::array::from_fn(|i| RowSVector::from_fn(|_, j| 1.0 / (1 + i + 2 * j) as f32));
    let observe = |x: &SVector<f32, 5>| {
        SVector::<f32, 8>::from_fn(|i, _| {
            let linear = (rows[i] * x)[0];
            linear + 0.1 * linear * linear
        })
    };
    let noise = ProcessNoise::independent(&SVector::repeat(1e-3)).unwrap();
    let mut posterior = Gaussian::independent(SVector::zeros(), &SVector::repeat(1.0)).unwrap();
    let mut gates = [Gate::open(); 8];
    let (y, r) = (SVector::repeat(0.1), SVector::repeat(0.01));
    criterion.bench_function("unscented 5 states, 8 channels", |bench| {
        bench.iter(|| {
            predict_constant(&mut posterior, &noise);
            Unscented::default().update(&mut posterior, observe, black_box(&y), &r, &mut gates)
        });
    });
}

fn steps(criterion: &mut Criterion) {
    kalman::<4, 2>(criterion);
    kalman::<6, 1>(criterion);
    kalman::<6, 4>(criterion);
    kalman::<12, 4>(criterion);
    unscented(criterion);
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_secs(1))
        .without_plots();
    targets = steps
}
criterion_main!(benches);
