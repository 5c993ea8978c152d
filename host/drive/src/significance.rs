//! Tests whether one model improves significantly on another: by the reduction of the
//! cross-validated error, and by Student's t test over stretches of the recordings.

use crate::least_squares::Fit;
use loadtwin_math::metrics::student_both_tails;

/// Part by which the error of what was left out has to fall for an effect to be added.
pub const LEAST_GAIN: f64 = 0.02;

/// Probability of a false alarm, over all candidates together.
pub const FALSE_ALARM: f64 = 0.02;

/// Part by which the error of what was left out falls from `current` to `better`.
pub fn gain(current: &Fit, better: &Fit) -> f64 {
    1.0 - (better.left_out_squares() / current.left_out_squares()).sqrt()
}

/// Whether `better` is better than `current` for certain, on what was left out.
///
/// `weighed`: priors were learnt from everything, what is left out included, which
/// lowers the error a little everywhere. Then it has to fall in quiet stretches, too.
pub fn certain(current: &Fit, better: &Fit, kinds: usize, weighed: bool) -> bool {
    let chance = if weighed {
        chance(&ratios(current, better))
    } else {
        p_value(current, better)
    };
    gain(current, better) >= LEAST_GAIN && chance * (kinds as f64) < FALSE_ALARM
}

/// Logarithms of the ratio of squared errors, stretch by stretch.
fn ratios(current: &Fit, better: &Fit) -> Vec<f64> {
    let pairs = current.left_out.iter().zip(&better.left_out);
    pairs
        .filter(|(a, b)| **a > 0.0 && **b > 0.0)
        .map(|(a, b)| (a / b).ln())
        .collect()
}

/// Probability that the error falls by chance as it does, stretch by stretch:
/// the smaller of two, doubled for the choice.
///
/// Student's t on the logarithm of the ratio of squared errors, to which a quiet
/// stretch says as much as a loud one; and on their difference, which loud ones
/// decide. Loudness that differs makes the latter careful.
pub fn p_value(current: &Fit, better: &Fit) -> f64 {
    let pairs = current.left_out.iter().zip(&better.left_out);
    let differences: Vec<f64> = pairs.map(|(a, b)| a - b).collect();
    let ratios = ratios(current, better);
    (2.0 * chance(&ratios).min(chance(&differences))).min(1.0)
}

/// Probability that a mean above 0 is as large by chance, by Student's t.
fn chance(x: &[f64]) -> f64 {
    let n = x.len() as f64;
    if n < 3.0 {
        return 1.0;
    }
    let mean = x.iter().sum::<f64>() / n;
    let variance = x.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let t = mean / (variance / n).sqrt().max(f64::MIN_POSITIVE);
    student_tail(t, n - 1.0)
}

/// `P(T > t)` of Student's distribution.
fn student_tail(t: f64, freedom: f64) -> f64 {
    let both = student_both_tails(t, freedom);
    if t > 0.0 {
        0.5 * both
    } else {
        1.0 - 0.5 * both
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tables of Student's distribution: 5 % above 1.833 with 9 degrees of freedom.
    #[test]
    fn student() {
        assert!((student_tail(1.833, 9.0) - 0.05).abs() < 1e-4);
        assert!((student_tail(-1.833, 9.0) - 0.95).abs() < 1e-4);
        assert!((student_tail(3.250, 9.0) - 0.005).abs() < 1e-5);
    }

    /// Differences of 16 stretches whose loudness differs a hundredfold and whose
    /// sign is chance: no more false alarms than named.
    #[test]
    fn chance_of_stretches_that_are_loud_and_quiet() {
        use rand::{RngExt, SeedableRng};
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let mut draw = || rng.random_range(-1.0..1.0_f64);
        let draws = 20_000;
        for named in [0.05, 0.001] {
            let alarms = (0..draws)
                .filter(|_| {
                    let x: Vec<f64> = (0..16).map(|_| 100_f64.powf(draw()) * draw()).collect();
                    chance(&x) < named
                })
                .count();
            let part = alarms as f64 / f64::from(draws);
            assert!(part < 1.1 * named, "{part} of {named}");
        }
    }
}
