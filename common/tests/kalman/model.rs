//! Models of the filter tests, the same as in `common/reference/filters.py`: a linear shaft and a
//! pendulum; reader of the reference tables.

use loadtwin_common::kalman::transition::{RandomWalk, Transition};
use loadtwin_common::kalman::{NonlinearTransition, Observation};
use nalgebra::{Matrix2x4, Matrix3, Matrix4, RowVector3, SVector, Vector2, Vector3};

/// Two inertias on a shaft: twist, two speeds, unknown torque on the first.
pub mod shaft {
    use super::{Matrix2x4, Matrix4, Vector2};

    pub fn transition() -> Matrix4<f32> {
        Matrix4::new(
            1.0, 0.01, -0.01, 0.0, -0.5, 0.98, 0.02, 0.01, 0.25, 0.01, 0.99, 0.0, 0.0, 0.0, 0.0,
            1.0,
        )
    }

    pub fn process_noise() -> Matrix4<f32> {
        let mut q = Matrix4::from_diagonal(&[1e-6, 1e-4, 1e-4, 0.25].into());
        q[(1, 2)] = 5e-5;
        q[(2, 1)] = 5e-5;
        q
    }

    pub fn observation() -> Matrix2x4<f32> {
        Matrix2x4::new(0.0, 1.0, 0.0, 0.0, 2.0, 0.0, 0.5, 0.1)
    }

    pub fn measurement_noise() -> Vector2<f32> {
        Vector2::new(0.01, 0.04)
    }
}

/// A pendulum with an unknown torque: angle, speed, load.
pub struct Pendulum;

pub const DT: f32 = 0.01;

impl NonlinearTransition<3, 1> for Pendulum {
    type Load = RandomWalk;

    fn propagate(&self, x: &Vector3<f32>) -> Vector3<f32> {
        Vector3::new(
            x[0] + DT * x[1],
            x[1] + DT * (x[2] - 9.81 * x[0].sin()),
            x[2],
        )
    }

    fn linearize_at(&self, x: &Vector3<f32>) -> Transition<3, 1> {
        let f = Matrix3::new(
            1.0,
            DT,
            0.0,
            -9.81 * DT * x[0].cos(),
            1.0,
            DT,
            0.0,
            0.0,
            1.0,
        );
        Transition::new(&f, RandomWalk)
    }
}

impl Observation<3, 2> for Pendulum {
    fn linearize_at(&self, channel: usize, x: &Vector3<f32>) -> (f32, RowVector3<f32>) {
        match channel {
            0 => (x[0].sin(), RowVector3::new(x[0].cos(), 0.0, 0.0)),
            _ => (
                x[1] + 0.1 * x[1] * x[1],
                RowVector3::new(0.0, 1.0 + 0.2 * x[1], 0.0),
            ),
        }
    }
}

/// The pendulum's two channels and one that depends on everything.
pub fn three_channels(x: &Vector3<f32>) -> Vector3<f32> {
    let y = |channel| Pendulum.observe(channel, x);
    Vector3::new(y(0), y(1), x[0] * x[2] + 0.05 * x[2] * x[2])
}

impl Pendulum {
    pub fn observe(&self, channel: usize, x: &Vector3<f32>) -> f32 {
        <Self as Observation<3, 2>>::linearize_at(self, channel, x).0
    }
}

/// Rows of a CSV file of numbers.
pub fn rows<const N: usize>(text: &str) -> Vec<SVector<f64, N>> {
    text.lines()
        .map(|line| {
            let numbers: Vec<f64> = line.split(',').map(|word| word.parse().unwrap()).collect();
            SVector::from_column_slice(&numbers)
        })
        .collect()
}
