//! Computes the 95 % prediction interval of a root mean square error on other recordings
//! (`prediction_interval`, a factor by Fisher's F) from the relative variance of its square over
//! stretches of the measured ones, correlation of neighbours included (`relative_variance`).

use special::Beta;

use super::student_quantile;

/// Stretches apart over which a recording may stay as loud as it is.
pub(super) const APART: usize = 3;

/// Probability of a value outside the interval.
pub(super) const OUTSIDE: f64 = 0.05;

/// Two-sided 5 % quantile of the normal distribution.
const NORMAL: f64 = 1.959_964;

/// Contribution of a stretch of a recording to an error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretch {
    /// In which recording it is; those of one recording follow each other.
    pub recording: usize,
    /// Sum of errors, or of their squares, >= 0.
    pub error: f64,
    /// Denominator of the sum, such as a number of values, > 0.
    pub size: f64,
}

/// Variance of `ratio = sum error / sum size` in parts of `ratio^2`, as if it were known for
/// certain: where little is known it is greater.
///
/// `v = (t / t_inf)^2 n / (n - 1) sum_i (e_i^2 + 2 sum_k w_k e_i e_(i+k))`, `k = 1..3` within a
/// recording, `w_k = 1 - k / 4`, `e_i = (error_i - ratio size_i) / sum error`; not less than
/// without the products. `t` is Student's for `n / sum w^2 - 1` degrees of freedom, one at least.
/// None where there is no error, or a single stretch.
///
/// Sources: Cochran 1977, Sampling techniques, section 6.3 (ratio); Newey and West 1987 (weights);
/// Priestley 1981, section 6.2.3 (degrees of freedom).
pub fn relative_variance(stretches: &[Stretch]) -> Option<f64> {
    let n = stretches.len() as f64;
    let sum = |of: fn(&Stretch) -> f64| stretches.iter().map(of).sum::<f64>();
    let (errors, sizes) = (sum(|s| s.error), sum(|s| s.size));
    if errors <= 0.0 || stretches.len() < 2 {
        return None;
    }
    let e: Vec<f64> = stretches
        .iter()
        .map(|s| s.error / errors - s.size / sizes)
        .collect();
    let squares: f64 = e.iter().map(|e| e * e).sum();
    let (mut variance, mut weights) = (squares, 1.0);
    for k in 1..=APART.min(e.len() - 1) {
        let w = 1.0 - k as f64 / (APART + 1) as f64;
        let pairs = (k..e.len()).filter(|&i| stretches[i].recording == stretches[i - k].recording);
        for i in pairs {
            variance += 2.0 * w * e[i] * e[i - k];
            weights += 2.0 * w * w / n;
        }
    }
    let freedom = (n / weights - 1.0).max(1.0);
    Some(
        variance.max(squares) * n / (n - 1.0)
            * (student_quantile(freedom, OUTSIDE) / NORMAL).powi(2),
    )
}

/// 95 % interval of a root mean square on other recordings, as many and as long, where its square
/// here has that relative variance; none above a relative variance of 4, where it would be wider
/// than a factor of a thousand.
pub fn prediction_interval(root: f64, relative_variance: f64) -> Option<[f64; 2]> {
    let factor = prediction_factor(relative_variance)?.sqrt();
    Some([root / factor, root * factor])
}

/// Factor that a mean square of other recordings, as many and as long, is not above, nor its
/// inverse below, in 95 of 100 cases: the quantile of Fisher's F for `2 / v` degrees of freedom
/// on both sides, which a sum of squares with the relative variance `v` is taken to have; none
/// for `v` above 4, where the factor is beyond any use.
///
/// Source: Satterthwaite 1946, An approximate distribution of estimates of variance components.
fn prediction_factor(relative_variance: f64) -> Option<f64> {
    if !(0.0..=4.0).contains(&relative_variance) {
        return None;
    }
    let half = 1.0 / relative_variance;
    // Logarithms are normal long before the function below runs out of digits.
    if half > 1e3 {
        return Some((NORMAL * (2.0 * relative_variance).sqrt()).exp());
    }
    let x = (0.5 * OUTSIDE).inv_inc_beta(half, half, half.ln_beta(half));
    Some((1.0 - x) / x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{Rng, RngExt, SeedableRng};
    use rand_distr::StandardNormal;

    /// Tables: F 39.00, 3.717 and 1.000.
    #[test]
    fn quantiles_equal_tables() {
        for (freedom, f) in [(2.0, 39.00), (10.0, 3.717), (1e12, 1.000)] {
            let found = prediction_factor(2.0 / freedom).unwrap();
            assert!((found / f - 1.0).abs() < 1e-3, "{found}");
        }
        let step = prediction_factor(1.001e-3).unwrap() / prediction_factor(0.999e-3).unwrap();
        assert!((1.0..1.000_5).contains(&step), "{step}");
    }

    /// By hand: errors 1 and 3 of sizes 1 and 1 make `e = -+ 1/4`, their squares 1/8; the
    /// product at weight 3/4 is negative and left out; twice that for two of them, one degree
    /// of freedom.
    #[test]
    fn two_stretches_by_hand() {
        let stretch = |recording, error| Stretch {
            recording,
            error,
            size: 1.0,
        };
        let expected = 0.25 * (12.706_f64 / 1.960).powi(2);
        for recording in [0, 1] {
            let found = relative_variance(&[stretch(0, 1.0), stretch(recording, 3.0)]).unwrap();
            assert!((found / expected - 1.0).abs() < 1e-3, "{found}");
        }
        assert_eq!(relative_variance(&[stretch(0, 0.0); 2]), None);
        assert_eq!(relative_variance(&[stretch(0, 1.0)]), None);
        assert_eq!(prediction_interval(1.0, 4.1), None);
    }

    /// Mean squares of 16 stretches of 40 values whose loudness walks from stretch to stretch
    /// (correlation 0.3, a factor of 1.6 either way): of other such recordings 94 in 100 are
    /// inside. Without the products it would be 87. At a correlation of 0.6 it is 84: a single
    /// recording does not show for how long it is loud.
    #[test]
    fn other_recordings_are_inside() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(7);
        let mut inside = 0;
        let trials = 2000;
        for _ in 0..trials {
            let [first, other] = [(); 2].map(|()| recording(&mut rng));
            let mean = |s: &[Stretch]| s.iter().map(|s| s.error).sum::<f64>();
            let factor = prediction_factor(relative_variance(&first).unwrap()).unwrap();
            let ratio = mean(&other) / mean(&first);
            inside += usize::from((1.0 / factor..=factor).contains(&ratio));
        }
        let part = inside as f64 / f64::from(trials);
        assert!((0.92..0.96).contains(&part), "{part}");
    }

    fn recording(rng: &mut impl Rng) -> Vec<Stretch> {
        let mut normal = || rng.sample::<f64, _>(StandardNormal);
        let mut loud = normal();
        (0..16)
            .map(|_| {
                loud = 0.3 * loud + 0.91_f64.sqrt() * normal();
                let sum: f64 = (0..40).map(|_| normal().powi(2)).sum();
                Stretch {
                    recording: 0,
                    error: (0.47 * loud).exp() * sum,
                    size: 40.0,
                }
            })
            .collect()
    }
}
