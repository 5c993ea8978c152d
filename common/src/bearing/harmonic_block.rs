//! Reduces the samples of a block (10 ms) to seven independent readings of equal variance for each
//! gauge, the measurement of the bearing's filter: sums over a constant and three harmonics of the
//! ball-pass phase (`HarmonicSums`), factored by Cholesky (`HarmonicBlock`).
//!
//! Within a block of 10 ms nothing that is looked for changes but the phase,
//! so that `y(t) = sum_k c_k e_k(t) + v`, `e = (1, cos Phi, sin Phi, cos 2 Phi, ..)`,
//! where `Phi` is the phase of ball passing by the wheel's angle alone. The
//! sums `E'E` and `E'y` then hold all information of the samples.

use serde::{Deserialize, Serialize};

use crate::bearing::{BASIS, GAUGES};
use crate::signal::trigonometry::{inverse_sqrt, sin_cos};

/// Part of the mean square of a basis function below which what is new in it
/// drowns in rounding.
const RESOLUTION: f32 = 1e-4;

/// Sums over a block.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct HarmonicSums {
    /// `E'E`, upper triangle.
    gram: [[f32; BASIS]; BASIS],
    /// `E'y` of each gauge.
    projected: [[f32; BASIS]; GAUGES],
    /// Samples.
    pub count: u16,
    /// Phase of ball passing since the start of the block (rad).
    pub phase: f32,
    /// Periods of sampling, those of lost samples among them.
    pub elapsed: u16,
    /// Samples in which a gauge gave no reading.
    pub missing: [u16; GAUGES],
    /// Sum of squares of the changes from sample to sample [(um/m)^2].
    changes: [f32; GAUGES],
    /// Readings of the last sample.
    last: [Option<f32>; GAUGES],
}

/// A block as independent readings of equal variance: `y = U c + v`.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct HarmonicBlock {
    /// `U`, upper triangular, `U'U = E'E`; a row of zeros is no reading.
    pub root: [[f32; BASIS]; BASIS],
    /// `y` of each gauge.
    pub reading: [[f32; BASIS]; GAUGES],
    /// Phase passed in the block (rad).
    pub phase: f32,
    /// Samples.
    pub count: u16,
    /// Periods of sampling, those of lost samples among them.
    pub elapsed: u16,
    /// Which gauges gave every reading.
    pub complete: [bool; GAUGES],
}

impl HarmonicSums {
    /// Adds a sample; `phase`: that of ball passing since the sample before (rad); `lost`: samples
    /// between the two.
    pub fn add(&mut self, phase: f32, lost: u16, readings: &[Option<f32>; GAUGES]) {
        self.phase += phase;
        let (sin, cos) = sin_cos(self.phase);
        let (cos2, sin2) = (cos * cos - sin * sin, 2.0 * sin * cos);
        let (cos3, sin3) = (cos2 * cos - sin2 * sin, sin2 * cos + cos2 * sin);
        let e = [1.0, cos, sin, cos2, sin2, cos3, sin3];
        for i in 0..BASIS {
            for j in i..BASIS {
                self.gram[i][j] += e[i] * e[j];
            }
        }
        for g in 0..GAUGES {
            if let (Some(last), Some(y)) = (self.last[g], readings[g]) {
                self.changes[g] += (y - last) * (y - last);
            }
        }
        self.last = *readings;
        for ((sums, missing), reading) in self
            .projected
            .iter_mut()
            .zip(&mut self.missing)
            .zip(readings)
        {
            let Some(y) = reading else {
                *missing = missing.saturating_add(1);
                continue;
            };
            for (sum, e) in sums.iter_mut().zip(&e) {
                *sum += e * y;
            }
        }
        self.count = self.count.saturating_add(1);
        self.elapsed = self.elapsed.saturating_add(lost + 1);
    }

    /// Mean square change of a gauge from sample to sample [(um/m)^2].
    pub fn mean_square_change(&self, g: usize) -> f32 {
        self.changes[g % GAUGES] / f32::from(self.count.max(1))
    }

    /// The block as independent readings.
    pub fn solve(&self) -> HarmonicBlock {
        let mut root = [[0.0; BASIS]; BASIS];
        let mut inverse = [0.0; BASIS];
        let floor = f32::from(self.count) * RESOLUTION;
        for k in 0..BASIS {
            let mut row = self.gram[k];
            for above in root.iter().take(k) {
                for j in k..BASIS {
                    row[j] -= above[k] * above[j];
                }
            }
            if row[k] > floor {
                inverse[k] = inverse_sqrt(row[k]);
                for j in k..BASIS {
                    root[k][j] = row[j] * inverse[k];
                }
            }
        }
        let reading = self.projected.map(|sums| {
            let mut y = [0.0; BASIS];
            for k in 0..BASIS {
                let mut sum = sums[k];
                for i in 0..k {
                    sum -= root[i][k] * y[i];
                }
                y[k] = sum * inverse[k];
            }
            y
        });
        HarmonicBlock {
            root,
            reading,
            phase: self.phase,
            count: self.count,
            elapsed: self.elapsed,
            complete: self.missing.map(|missing| missing == 0),
        }
    }
}
