//! Computes statistics of samples: mean, mean square, standard deviation, Gumbel quantile for
//! thresholds, and standard deviation of the white noise in a signal.

/// Mean of the finite values; NaN where there are none.
pub(crate) fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values
        .filter(|v| v.is_finite())
        .fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
    sum / n
}

/// Mean square of the known values; none where there are none.
pub(crate) fn mean_square(x: &[f64]) -> Option<f64> {
    let known = x.iter().filter(|v| v.is_finite());
    let count = known.clone().count();
    (count > 0).then(|| known.map(|v| v * v).sum::<f64>() / count as f64)
}

/// Mean and standard deviation.
pub(crate) fn mean_and_std(x: &[f64]) -> (f64, f64) {
    let n = x.len();
    let mean = x.iter().sum::<f64>() / n.max(1) as f64;
    let squares = x.iter().map(|v| (v - mean).powi(2)).sum::<f64>();
    (mean, (squares / n.saturating_sub(1).max(1) as f64).sqrt())
}

/// The value that an extreme-value distribution with the null samples' mean and
/// standard deviation exceeds with `probability`.
pub(crate) fn gumbel_quantile(samples: &[f64], probability: f64) -> f64 {
    if samples.len() < 2 {
        return 0.0;
    }
    let (mean, spread) = mean_and_std(samples);
    let width = spread * 6.0_f64.sqrt() / std::f64::consts::PI;
    mean - 0.577_2 * width - width * (-(1.0 - probability).ln()).ln()
}

/// Standard deviation of the white noise in `x`, whatever moves slowly against the samples: third
/// differences of noise have `sqrt(1 + 9 + 9 + 1)` times its own; their median, so that a jump does
/// not count. 0 where fewer than four neighbours are known.
pub(crate) fn white_noise_std(x: &[f64]) -> f64 {
    /// Median of the size of a standard normal number.
    const MEDIAN: f64 = 0.674_5;
    let third = |w: &[f64]| (w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]).abs();
    let mut sizes: Vec<f64> = x.windows(4).map(third).filter(|d| d.is_finite()).collect();
    if sizes.is_empty() {
        return 0.0;
    }
    let middle = sizes.len() / 2;
    let median = *sizes.select_nth_unstable_by(middle, f64::total_cmp).1;
    median / (MEDIAN * 20.0_f64.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;

    /// A vibration of 30 Hz at 1 kHz, a step and a gap beside noise of 2.
    #[test]
    fn noise_is_estimated_beside_vibration_and_steps() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let mut x: Vec<f64> = (0..20_000)
            .map(|i| {
                let slow = 100.0 * (std::f64::consts::TAU * 0.03 * f64::from(i)).sin();
                let step = if i > 9000 { 1e4 } else { 0.0 };
                slow + step + 2.0 * rng.sample::<f64, _>(StandardNormal)
            })
            .collect();
        x[500..600].fill(f64::NAN);
        let estimated = white_noise_std(&x);
        assert!((estimated / 2.0 - 1.0).abs() < 0.05, "{estimated}");
        assert_eq!(white_noise_std(&[1.0, 2.0]), 0.0);
    }
}
