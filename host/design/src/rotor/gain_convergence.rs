//! Computes after how many samples the gains of a rotor's filter have converged: runs the
//! covariance recursion until the sum of the load variances stays within 2 % of its last value. Two
//! functions bring matrices to the filter's layout: increments `D`, lower triangle.

use faer::Mat;
use loadtwin_common::rotor::filter::{
    LoadTransition, ObservationRow, StateEstimate, predict_covariance, update,
};

/// Relative difference of the sum of the load variances to its last at which the gain has converged.
const CONVERGED: f64 = 0.02;

/// Longest time that is looked at for it [s].
const LONGEST_S: f64 = 20.0;

/// The recursion of the covariance, as in the estimator but in f64.
pub(crate) struct CovarianceRecursion<'a> {
    /// Transition over the states of the filter.
    pub f: &'a Mat<f64>,
    /// Row of each sensor.
    pub rows: &'a [Vec<f64>],
    /// State of each sensor's bias.
    pub biases: &'a [Option<usize>],
    /// Variance of each sensor.
    pub variances: &'a [f64],
    /// Process noise.
    pub q: &'a Mat<f64>,
    /// Covariance before the first sample.
    pub p: &'a Mat<f64>,
    /// How the forces move in a sample.
    pub turn: LoadTransition<f64>,
    /// Sample period [s].
    pub dt_s: f64,
}

impl CovarianceRecursion<'_> {
    /// Samples after which the sum of the variances of the loads differs by no more than
    /// [`CONVERGED`] from what it ends at.
    pub fn converged_after(&self, (modes, states): (usize, usize)) -> u32 {
        match (modes, states) {
            (8, 20) => self.sized::<8, 20>(),
            (8, 24) => self.sized::<8, 24>(),
            _ => self.most(),
        }
    }

    fn most(&self) -> u32 {
        (LONGEST_S / self.dt_s) as u32
    }

    fn sized<const NZ: usize, const NX: usize>(&self) -> u32 {
        let dense: [[f64; NX]; NZ] =
            std::array::from_fn(|i| std::array::from_fn(|j| changes(self.f, NZ, i, j)));
        let rows: Vec<ObservationRow<f64, NZ>> = (self.rows.iter().zip(self.biases))
            .map(|(row, bias)| ObservationRow {
                modal: std::array::from_fn(|j| row[j]),
                bias: *bias,
            })
            .collect();
        let q = triangle(self.q);
        let mut estimate = StateEstimate::<f64, NX> {
            state: [0.0; NX],
            covariance: std::array::from_fn(|i| std::array::from_fn(|j| self.p[(i, j)])),
        };
        let loads = 2 * NZ..2 * NZ + 2 * self.turn.pairs;
        let mut history = Vec::new();
        for _ in 0..self.most() {
            predict_covariance(&mut estimate.covariance, &dense, &self.turn, |i| q[i]);
            for (row, variance) in rows.iter().zip(self.variances) {
                update(&mut estimate, row, 0.0, *variance, |_| true);
            }
            history.push(
                loads
                    .clone()
                    .map(|d| estimate.covariance[d][d])
                    .sum::<f64>(),
            );
        }
        let Some(last) = history.last().copied() else {
            return self.most();
        };
        let near = |p: &f64| (p - last).abs() <= CONVERGED * last;
        let settled = history.iter().rev().take_while(|p| near(p)).count();
        (history.len() - settled) as u32 + 1
    }
}

/// `D`, row `i` and column `j`, of the transition `f` of `modes` modal displacements.
pub(crate) fn changes(f: &Mat<f64>, modes: usize, i: usize, j: usize) -> f64 {
    f[(modes + i, j)] - f64::from(u8::from(j == modes + i))
}

/// Lower triangle by rows.
pub(crate) fn triangle(m: &Mat<f64>) -> Vec<f64> {
    (0..m.nrows())
        .flat_map(|i| (0..=i).map(move |j| (i, j)))
        .map(|at| m[at])
        .collect()
}
