//! Compares the linear, extended and unscented filter, the constant gain and the Butterworth filter
//! with filterpy and scipy, step by step: states and covariances agree to 2e-4 standard deviations,
//! those of the unscented filter and of the steady state to 1e-3.
//!
//! `common/reference/filters.py` made the numbers in double precision with filterpy
//! 1.4.5 and scipy 1.17.1. Tolerances are relative to the standard deviation
//! of the state (for covariances: to both): f32 rounds a step of a few hundred
//! operations by some 1e-6, and the filters forget within tens of steps.

use crate::model::{Pendulum, rows, shaft, three_channels};
use loadtwin_common::kalman::gaussian::Gaussian;
use loadtwin_common::kalman::innovation::{Gate, Innovation};
use loadtwin_common::kalman::scheduled_gain::{GainBin, GainSchedule};
use loadtwin_common::kalman::transition::{ProcessNoise, RandomWalk, Transition};
use loadtwin_common::kalman::unscented::Unscented;
use loadtwin_common::kalman::{Observation, predict, predict_extended, update};
use loadtwin_common::signal::butterworth::{Butterworth, ButterworthState};
use nalgebra::{RowVector3, SMatrix, SVector, Vector1, Vector2, Vector3, Vector4};

/// Largest difference from a reference row (`NY` measurements, `NX` states,
/// upper triangle of P), in standard deviations.
fn difference<const NX: usize>(posterior: &Gaussian<NX>, reference: &[f64]) -> f64 {
    let (state, upper) = reference.split_at(NX);
    let mut expected = SMatrix::<f64, NX, NX>::zeros();
    let mut entries = upper.iter();
    for j in 0..NX {
        for i in 0..=j {
            expected[(i, j)] = *entries.next().unwrap();
        }
    }
    assert!(entries.next().is_none());
    let p = posterior.covariance();
    let mut worst = 0.0f64;
    for j in 0..NX {
        let sd_j = expected[(j, j)].sqrt();
        worst = worst.max((f64::from(posterior.state[j]) - state[j]).abs() / sd_j);
        for i in 0..=j {
            let sd_i = expected[(i, i)].sqrt();
            worst = worst.max((f64::from(p[(i, j)]) - expected[(i, j)]).abs() / (sd_i * sd_j));
        }
    }
    worst
}

fn shaft_filter() -> (Transition<4, 1>, ProcessNoise<4>, Gaussian<4>) {
    (
        Transition::try_new(&shaft::transition(), RandomWalk).unwrap(),
        ProcessNoise::try_new(&shaft::process_noise()).unwrap(),
        Gaussian::independent(SVector::zeros(), &Vector4::new(0.1, 1.0, 1.0, 100.0)).unwrap(),
    )
}

#[test]
fn linear_filter_equals_filterpy() {
    let (transition, noise, mut posterior) = shaft_filter();
    let (h, r) = (shaft::observation(), shaft::measurement_noise());
    for (k, row) in rows::<16>(include_str!("../../reference/kalman.csv"))
        .iter()
        .enumerate()
    {
        predict(&mut posterior, &transition, &noise);
        for i in 0..2 {
            let nu = row[i] as f32 - (h.row(i) * posterior.state)[0];
            assert!(
                update(
                    &mut posterior,
                    &h.row(i).into(),
                    nu,
                    r[i],
                    &mut Gate::open()
                )
                .used()
            );
        }
        let worst = difference(&posterior, &row.as_slice()[2..]);
        assert!(worst < 2e-4, "step {k}: {worst}");
    }
}

#[test]
fn constant_gain_and_steady_state_equal_the_riccati_solution() {
    let reference = rows::<16>(include_str!("../../reference/steady.csv"));
    let gain = rows::<2>(include_str!("../../reference/steady_gain.csv"));
    let load_variance = reference[0][15] as f32;
    let bins = [GainBin {
        gain: SMatrix::from_fn(|i, j| gain[i][j] as f32),
        load_variances: Vector1::new(load_variance),
    }];
    let schedule = GainSchedule::<4, 2, 1>::try_new(&bins).unwrap();
    let (transition, noise, mut posterior) = shaft_filter();
    let (h, r) = (shaft::observation(), shaft::measurement_noise());
    let mut state = Vector4::zeros();
    for (k, row) in reference.iter().enumerate() {
        let y = Vector2::new(row[0] as f32, row[1] as f32);
        state = transition.propagate(&state);
        let place = schedule.at(0.1 * k as f32).unwrap();
        let nu = y - h * state;
        assert_eq!(place.correct(&mut state, &nu), 0b11);
        assert!((place.load_variances()[0] - load_variance).abs() < 1e-6 * load_variance);
        for i in 0..4 {
            let error = (f64::from(state[i]) - row[2 + i]).abs();
            assert!(
                error < 2e-5 * (1.0 + row[2 + i].abs()),
                "step {k}, state {i}: {error}"
            );
        }
    }
    for _ in 0..5000 {
        predict(&mut posterior, &transition, &noise);
        for i in 0..2 {
            update(
                &mut posterior,
                &h.row(i).into(),
                0.0,
                r[i],
                &mut Gate::open(),
            );
        }
    }
    let mut steady: Vec<f64> = posterior.state.iter().map(|x| f64::from(*x)).collect();
    steady.extend(&reference[0].as_slice()[6..]);
    let worst = difference(&posterior, &steady);
    assert!(worst < 1e-3, "{worst}");
}

fn pendulum_belief() -> (ProcessNoise<3>, Gaussian<3>) {
    (
        ProcessNoise::independent(&Vector3::new(1e-6, 1e-4, 0.01)).unwrap(),
        Gaussian::independent(Vector3::zeros(), &Vector3::new(0.1, 0.5, 4.0)).unwrap(),
    )
}

#[test]
fn extended_filter_equals_filterpy() {
    let (noise, mut posterior) = pendulum_belief();
    let r = [1e-3, 4e-3];
    for (k, row) in rows::<11>(include_str!("../../reference/extended.csv"))
        .iter()
        .enumerate()
    {
        predict_extended(&mut posterior, &Pendulum, &noise).unwrap();
        // filterpy linearises all channels at the prior.
        let prior = posterior.state;
        for i in 0..2 {
            let (y, h): (f32, RowVector3<f32>) =
                <Pendulum as Observation<3, 2>>::linearize_at(&Pendulum, i, &prior);
            let nu = row[i] as f32 - y - (h * (posterior.state - prior))[0];
            assert!(update(&mut posterior, &h, nu, r[i], &mut Gate::open()).used());
        }
        let worst = difference(&posterior, &row.as_slice()[2..]);
        assert!(worst < 2e-4, "step {k}: {worst}");
    }
}

#[test]
fn unscented_filter_equals_filterpy() {
    let (noise, mut posterior) = pendulum_belief();
    let unscented = Unscented::try_new(0.8, 2.0, 0.5).unwrap();
    let r = Vector3::new(1e-3, 4e-3, 0.1);
    let mut gates = [Gate::open(); 3];
    for (k, row) in rows::<12>(include_str!("../../reference/unscented.csv"))
        .iter()
        .enumerate()
    {
        let f = |x: &Vector3<f32>| {
            use loadtwin_common::kalman::NonlinearTransition;
            Pendulum.propagate(x)
        };
        unscented.predict(&mut posterior, f, &noise).unwrap();
        let y = Vector3::new(row[0] as f32, row[1] as f32, row[2] as f32);
        let result = unscented
            .update(&mut posterior, three_channels, &y, &r, &mut gates)
            .unwrap();
        assert!(result.iter().all(Innovation::used));
        let worst = difference(&posterior, &row.as_slice()[3..]);
        assert!(worst < 1e-3, "step {k}: {worst}");
    }
}

#[test]
fn butterworth_equals_scipy() {
    let filter = Butterworth::try_new(25.0, 0.001).unwrap();
    let mut state = ButterworthState::default();
    for row in rows::<3>(include_str!("../../reference/butterworth.csv")) {
        let out = filter.step(&mut state, row[0] as f32);
        assert!(
            (f64::from(out.low) - row[1]).abs() < 2e-6,
            "{row:?} {out:?}"
        );
        assert!(
            (f64::from(out.high) - row[2]).abs() < 2e-6,
            "{row:?} {out:?}"
        );
    }
}
