//! Periodic function of the carrier angle, given by a table: the sensitivity of a simulated gauge.
//! Interpolates it, computes its RMS and peak, and gives a copy with lower and wider peaks.

use std::f64::consts::TAU;

/// Values in equal steps over a turn; one value is a constant.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct AngleFunction(Vec<f64>);

impl AngleFunction {
    /// `values` must not be empty.
    pub(crate) fn new(values: Vec<f64>) -> Self {
        Self(values)
    }

    /// The value at `angle` [rad], by a cubic through the four values around it.
    pub(crate) fn at(&self, angle: f64) -> f64 {
        let n = self.0.len();
        if n == 1 {
            return self.0[0];
        }
        let position = (angle / TAU).rem_euclid(1.0) * n as f64;
        let (left, u) = (position as usize % n, position.fract());
        let value = |offset: usize| self.0[(left + n - 1 + offset) % n];
        let (a, b, c, d) = (value(0), value(1), value(2), value(3));
        b + 0.5 * u * (c - a + u * (2.0 * a - 5.0 * b + 4.0 * c - d + u * (3.0 * (b - c) + d - a)))
    }

    /// Root of the mean square.
    pub(crate) fn rms(&self) -> f64 {
        (self.0.iter().map(|v| v * v).sum::<f64>() / self.0.len() as f64).sqrt()
    }

    /// Largest magnitude.
    pub(crate) fn peak(&self) -> f64 {
        self.0.iter().fold(0.0, |peak, v| v.abs().max(peak))
    }

    /// Angle of the largest magnitude [rad].
    pub(crate) fn peak_angle(&self) -> f64 {
        let peak = self.peak();
        let i = self.0.iter().position(|v| v.abs() == peak).unwrap_or(0);
        i as f64 * TAU / self.0.len() as f64
    }

    /// Whether it is made of narrow peaks, as under passing planets.
    pub(crate) fn is_intermittent(&self) -> bool {
        self.peak() > 2.0 * self.rms()
    }

    /// Spread over neighbouring angles until its peak is `part` of what it
    /// was, 0 to 1: a load that is not a point. The mean stays.
    pub(crate) fn with_peak(&self, part: f64) -> Self {
        let target = part * self.peak();
        let (mut narrow, mut wide) = (0.0, TAU);
        for _ in 0..40 {
            let middle = 0.5 * (narrow + wide);
            if self.spread(middle).peak() > target {
                narrow = middle;
            } else {
                wide = middle;
            }
        }
        self.spread(narrow)
    }

    /// Convolution with a normal distribution of standard deviation `width` [rad].
    fn spread(&self, width: f64) -> Self {
        let n = self.0.len();
        let weight = |i: usize| {
            let angle = TAU * i.min(n - i) as f64 / n as f64;
            (-0.5 * (angle / width.max(1e-9)).powi(2)).exp()
        };
        let weights: Vec<f64> = (0..n).map(weight).collect();
        let sum: f64 = weights.iter().sum();
        Self(
            (0..n)
                .map(|i| {
                    (0..n)
                        .map(|k| weights[k] * self.0[(i + k) % n])
                        .sum::<f64>()
                        / sum
                })
                .collect(),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn three_peaks() -> AngleFunction {
        AngleFunction::new(
            (0..512)
                .map(|i| ((3.0 * TAU * f64::from(i) / 512.0).cos() * 30.0 - 30.0).exp())
                .collect(),
        )
    }

    #[test]
    fn it_is_smooth_between_the_values_and_over_the_end_of_the_turn() {
        let f = AngleFunction::new((0..64).map(|i| (TAU * f64::from(i) / 64.0).sin()).collect());
        for i in -1000..1000 {
            let angle = f64::from(i) * 0.01;
            assert!((f.at(angle) - angle.sin()).abs() < 1e-4);
        }
        assert_eq!(AngleFunction::new(vec![2.5]).at(17.0), 2.5);
        assert!(f.at(-1e-18).abs() < 1e-9);
    }

    #[test]
    fn a_lower_peak_keeps_its_mean_and_its_place() {
        let (f, g) = (three_peaks(), three_peaks().with_peak(0.85));
        let mean = |f: &AngleFunction| f.0.iter().sum::<f64>() / 512.0;
        assert!((g.peak() / f.peak() - 0.85).abs() < 1e-3);
        assert!((mean(&g) / mean(&f) - 1.0).abs() < 1e-9);
        assert!((g.peak_angle() - f.peak_angle()).abs() < 0.02);
        assert!(f.is_intermittent());
    }
}
