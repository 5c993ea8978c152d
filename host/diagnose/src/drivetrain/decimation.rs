//! Resamples: decimates signals and residuals by block means, interpolates maps over the angle
//! linearly and periodically, and fills missing values with the last known one.

/// Fewer samples: means of so many.
pub(crate) struct Decimator {
    pub every: usize,
    /// Raw samples at both ends where accelerations are not known, or not from when a late gauge
    /// reads them.
    pub edge: usize,
    pub n: usize,
}

impl Decimator {
    pub fn count(&self) -> usize {
        self.n / self.every
    }

    pub fn times(&self, dt_s: f64) -> Vec<f64> {
        (0..self.count())
            .map(|i| (i as f64 * self.every as f64 + 0.5 * (self.every as f64 - 1.0)) * dt_s)
            .collect()
    }

    /// Means of the known values; NaN where there are none.
    pub fn means(&self, x: &[f64]) -> Vec<f64> {
        x.chunks_exact(self.every)
            .map(|chunk| {
                let (sum, n) = chunk
                    .iter()
                    .filter(|v| v.is_finite())
                    .fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
                sum / n
            })
            .collect()
    }

    /// Means where all samples are known, NaN elsewhere and at the ends.
    pub fn residual(&self, x: &[f64]) -> Vec<f64> {
        x.chunks_exact(self.every)
            .enumerate()
            .map(|(i, chunk)| {
                let from = i * self.every;
                if from < self.edge || from + self.every + self.edge > self.n {
                    return f64::NAN;
                }
                chunk.iter().sum::<f64>() / self.every as f64
            })
            .collect()
    }
}

/// The value and the slope of a map at `angle`.
pub(crate) fn interpolate_map(table: &[f64], angle: f64) -> (f64, f64) {
    let n = table.len();
    if n == 1 {
        return (table[0], 0.0);
    }
    let position = (angle / std::f64::consts::TAU).rem_euclid(1.0) * n as f64;
    let left = position as usize % n;
    let (a, b) = (table[left], table[(left + 1) % n]);
    let step = std::f64::consts::TAU / n as f64;
    (a + position.fract() * (b - a), (b - a) / step)
}

/// Each value that is not known is the one before, the first ones the first known.
pub(crate) fn forward_filled(values: &[f64]) -> Vec<f64> {
    let mut last = values
        .iter()
        .copied()
        .find(|v| v.is_finite())
        .unwrap_or(0.0);
    values
        .iter()
        .map(|v| {
            if v.is_finite() {
                last = *v;
            }
            last
        })
        .collect()
}
