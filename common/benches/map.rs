//! Measures the time of evaluating a strain map at one carrier angle on the host: interpolation in
//! a table of 512 entries, against a sum of 3, 6 or 48 harmonics.
//!
//! `cargo bench -p loadtwin-common --bench map`. Of the example's gauges,
//! those of the ring gear need orders up to 48 for an error below 1 % of their
//! peak, those of the torque arm up to 6, those of the housing up to 3.

use std::hint::black_box;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use loadtwin_common::signal::periodic_lookup::PeriodicLookup;
use loadtwin_common::signal::phase::Phase;

/// `sum a_k cos(k angle) + b_k sin(k angle)` by the recurrence of the angle sum.
fn harmonics(coefficients: &[(f32, f32)], angle_rad: f32) -> f32 {
    let (sine, cosine) = libm::sincosf(angle_rad);
    let (mut s, mut c, mut sum) = (0.0, 1.0, 0.0);
    for (a, b) in coefficients {
        (s, c) = (s * cosine + c * sine, c * cosine - s * sine);
        sum += a * c + b * s;
    }
    sum
}

fn map(criterion: &mut Criterion) {
    let bytes: Vec<u8> = (0..512)
        .flat_map(|i| (i as f32).sin().to_le_bytes())
        .collect();
    let table = PeriodicLookup::try_new(&bytes, "map").unwrap();
    let mut phase = Phase(0);
    criterion.bench_function("table of 512", |bench| {
        bench.iter(|| {
            phase = phase.wrapping_add(Phase(0x0123_4567_89ab_cdef));
            black_box(table.at(phase))
        });
    });
    for orders in [3, 6, 48] {
        let coefficients: Vec<(f32, f32)> = (0..orders).map(|k| (k as f32, 1.0)).collect();
        let mut angle = 0.0;
        criterion.bench_function(&format!("{orders} harmonics"), |bench| {
            bench.iter(|| {
                angle = (angle + 0.01) % 6.0;
                black_box(harmonics(black_box(&coefficients), angle))
            });
        });
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_millis(500));
    targets = map
}
criterion_main!(benches);
