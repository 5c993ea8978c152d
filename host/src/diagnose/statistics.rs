//! Means, mean squares, and what chance reaches.

/// Mean of what is finite; NaN where nothing is.
pub(super) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values
        .filter(|v| v.is_finite())
        .fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
    sum / n
}

/// Mean square of what is known; none where nothing is.
pub(super) fn mean_square(x: &[f64]) -> Option<f64> {
    let known = x.iter().filter(|v| v.is_finite());
    let count = known.clone().count();
    (count > 0).then(|| known.map(|v| v * v).sum::<f64>() / count as f64)
}

/// Mean and standard deviation.
pub(super) fn mean_and_spread(x: &[f64]) -> (f64, f64) {
    let n = x.len();
    let mean = x.iter().sum::<f64>() / n.max(1) as f64;
    let squares = x.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
    (mean, (squares / n.saturating_sub(1).max(1) as f64).sqrt())
}

/// The value that an extreme-value distribution with the draws' mean and
/// standard deviation exceeds with `probability`.
pub(super) fn gumbel(draws: &[f64], probability: f64) -> f64 {
    if draws.len() < 2 {
        return 0.0;
    }
    let (mean, spread) = mean_and_spread(draws);
    let width = spread * 6.0_f64.sqrt() / std::f64::consts::PI;
    mean - 0.577_2 * width - width * (-(1.0 - probability).ln()).ln()
}
