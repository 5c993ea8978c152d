//! Computes the mean normalised innovation squared (NIS) of a recording and the chi-squared bounds
//! that it has in a consistent filter; also quantiles of the chi-squared distribution.

use special::Gamma;

/// Mean NIS and its bounds, in one pass.
///
/// With the channels in use as degrees of freedom `k`, the NIS `nu' S^-1 nu` of a consistent filter
/// is chi-squared distributed, its mean `k`. Channels may come and go.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NisConsistency {
    samples: u64,
    sum: f64,
    degrees: f64,
}

impl NisConsistency {
    /// Takes the NIS of one sample and the number of channels in it. A sample without channels
    /// or with a NIS that is not finite is passed over.
    pub fn push(&mut self, nis: f64, channels: usize) {
        if nis.is_finite() && channels > 0 {
            self.samples += 1;
            self.sum += nis;
            self.degrees += channels as f64;
        }
    }

    /// Number of samples with a NIS.
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// Mean NIS of a sample.
    pub fn mean(&self) -> Option<f64> {
        self.per_sample(self.sum)
    }

    /// Mean number of channels: what the mean NIS is to be.
    pub fn expected(&self) -> Option<f64> {
        self.per_sample(self.degrees)
    }

    /// Bounds of the mean NIS of a consistent filter at a probability, e.g. 0.95.
    ///
    /// `n NIS_mean` is chi-squared with the sum of all degrees of freedom.
    pub fn mean_bounds(&self, probability: f64) -> Option<[f64; 2]> {
        let bounds = chi_squared_bounds(probability, self.degrees);
        (self.samples > 0).then(|| bounds.map(|b| b / self.samples as f64))
    }

    fn per_sample(&self, sum: f64) -> Option<f64> {
        (self.samples > 0).then(|| sum / self.samples as f64)
    }
}

/// The two-sided bounds that a chi-squared variable keeps with a probability.
pub fn chi_squared_bounds(probability: f64, degrees: f64) -> [f64; 2] {
    let tail = (1.0 - probability) / 2.0;
    [
        chi_squared_quantile(tail, degrees),
        chi_squared_quantile(1.0 - tail, degrees),
    ]
}

/// `x` such that a chi-squared variable with `degrees` > 0 is below it with probability `p`,
/// 0 < p < 1; relative error below 1e-9 (1e-6 above 1000 degrees); NaN outside that range.
///
/// Up to 1000 degrees the regularised incomplete gamma function is inverted by bisection; above,
/// its series gets long and the cube-root approximation is better than anyone needs.
///
/// Source: Wilson and Hilferty 1931, for more than 1000 degrees.
pub fn chi_squared_quantile(p: f64, degrees: f64) -> f64 {
    if !(p > 0.0 && p < 1.0 && degrees > 0.0 && degrees.is_finite()) {
        return f64::NAN;
    }
    let variance = 2.0 / (9.0 * degrees);
    if degrees > 1000.0 {
        let z = normal_quantile(p);
        return degrees * (1.0 - variance + z * variance.sqrt()).powi(3);
    }
    bisect(0.0, degrees + 100.0 * (degrees.sqrt() + 1.0), |x| {
        (x / 2.0).inc_gamma(degrees / 2.0) < p
    })
}

/// From the chi-squared distribution with one degree of freedom, whose square root is normal.
fn normal_quantile(p: f64) -> f64 {
    let two_sided = (2.0 * p - 1.0).abs();
    let z = bisect(0.0, 40.0, |z| (z * z / 2.0).inc_gamma(0.5) < two_sided);
    if p < 0.5 { -z } else { z }
}

/// Where `below` turns false, between `low` and `high`, to the last digit.
fn bisect(mut low: f64, mut high: f64, below: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..200 {
        let middle = f64::midpoint(low, high);
        if below(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    f64::midpoint(low, high)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_equal_scipy() {
        let text = include_str!("../../../tests/reference/metrics.json");
        let json: serde_json::Value = serde_json::from_str(text).unwrap();
        let rows: Vec<[f64; 3]> = serde_json::from_value(json["chi_squared"].clone()).unwrap();
        assert_eq!(rows.len(), 35);
        for [p, degrees, expected] in rows {
            let found = chi_squared_quantile(p, degrees);
            let tolerance = if degrees > 1000.0 { 1e-6 } else { 1e-9 };
            let relative = (found / expected - 1.0).abs();
            assert!(
                relative < tolerance,
                "p {p}, {degrees} degrees: {found}, {expected}"
            );
        }
        assert!(chi_squared_quantile(1.0, 4.0).is_nan());
        assert!(chi_squared_quantile(0.5, 0.0).is_nan());
    }

    /// Two samples of 4 channels, one of 2: mean (3 + 5 + 1)/3, expected 10/3.
    #[test]
    fn mean_and_bounds_follow_the_channels_in_use() {
        let mut nis = NisConsistency::default();
        assert_eq!((nis.mean(), nis.mean_bounds(0.95)), (None, None));
        for (value, channels) in [(3.0, 4), (5.0, 4), (1.0, 2), (f64::NAN, 4), (0.0, 0)] {
            nis.push(value, channels);
        }
        assert_eq!((nis.samples(), nis.mean()), (3, Some(3.0)));
        assert_eq!(nis.expected(), Some(10.0 / 3.0));
        // Tables: 3.247 and 20.483 for 10 degrees of freedom.
        let [low, high] = nis.mean_bounds(0.95).unwrap();
        assert!((low - 3.247 / 3.0).abs() < 1e-3 && (high - 20.483 / 3.0).abs() < 1e-3);
    }
}
