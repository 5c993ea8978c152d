//! Computes the mean difference of two estimators on the same samples, with a 95 % interval that
//! accounts for correlation in time.

use super::prediction_interval::{APART, OUTSIDE};
use super::student_quantile;

/// Stretches into which a sequence of differences is divided.
const STRETCHES: usize = 16;

/// Mean of the differences between two estimators on the same samples, with its 95 % interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairedDifference {
    /// Mean.
    pub mean: f64,
    /// Interval of the mean; none of fewer than four stretches.
    pub interval: Option<[f64; 2]>,
}

impl PairedDifference {
    /// Of `blocks` that follow each other, each the sum of its differences and their number.
    ///
    /// `m +- t sqrt(v)`, `v = n / (n - 1) sum_i (e_i^2 + 2 sum_k w_k e_i e_(i+k))`, `k = 1..3`,
    /// `w_k = 1 - k / 4`, `e_i = (sum_i - m size_i) / sum size` over at most 16 stretches; v is not
    /// less than without the products, t is Student's for `n / (1 + 2 sum_k w_k^2) - 1` degrees of
    /// freedom, at least one. None without a sample.
    ///
    /// Sources: Newey and West 1987 (weights); Priestley 1981, section 6.2.3 (degrees of freedom).
    pub fn of(blocks: &[(f64, f64)]) -> Option<Self> {
        let used: Vec<(f64, f64)> = blocks.iter().copied().filter(|b| b.1 > 0.0).collect();
        let size: f64 = used.iter().map(|b| b.1).sum();
        if used.is_empty() {
            return None;
        }
        let mean = used.iter().map(|b| b.0).sum::<f64>() / size;
        let e: Vec<f64> = used
            .chunks(used.len().div_ceil(STRETCHES))
            .map(|stretch| stretch.iter().map(|b| b.0 - mean * b.1).sum::<f64>() / size)
            .collect();
        let interval = (e.len() > APART).then(|| {
            let n = e.len() as f64;
            let squares: f64 = e.iter().map(|e| e * e).sum();
            let (mut variance, mut weights) = (squares, 1.0);
            for k in 1..=APART {
                let w = 1.0 - k as f64 / (APART + 1) as f64;
                variance += 2.0 * w * e.iter().zip(&e[k..]).map(|(a, b)| a * b).sum::<f64>();
                weights += 2.0 * w * w * (n - k as f64) / n;
            }
            let deviation = (variance.max(squares) * n / (n - 1.0)).sqrt();
            let half = student_quantile((n / weights - 1.0).max(1.0), OUTSIDE) * deviation;
            [mean - half, mean + half]
        });
        Some(Self { mean, interval })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;

    /// Means 1 and 3 of sizes 1 and 3: 2.5; two stretches make no interval.
    #[test]
    fn the_mean_is_over_samples() {
        assert_eq!(PairedDifference::of(&[]), None);
        assert_eq!(PairedDifference::of(&[(1.0, 0.0)]), None);
        let found = PairedDifference::of(&[(1.0, 1.0), (9.0, 3.0)]).unwrap();
        assert_eq!((found.mean, found.interval), (2.5, None));
        let same = PairedDifference::of(&[(0.5, 1.0); 20]).unwrap();
        assert_eq!(same.interval, Some([0.5, 0.5]));
    }

    /// White differences and differences whose correlation from block to block is 0.7, 64 blocks:
    /// the true mean is inside in 95 of 100 and in at least 90 of 100 sequences.
    #[test]
    fn the_true_mean_is_inside() {
        for (correlation, range) in [(0.0, 0.93..0.99), (0.7, 0.90..0.99)] {
            let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(11);
            let trials = 2000;
            let mut inside = 0;
            for _ in 0..trials {
                let mut state = 0.0;
                let blocks: Vec<(f64, f64)> = (0..64)
                    .map(|_| {
                        let white: f64 = rng.sample(StandardNormal);
                        state = correlation * state
                            + (1.0_f64 - correlation * correlation).sqrt() * white;
                        (5.0 * (0.3 + state), 5.0)
                    })
                    .collect();
                let [low, high] = PairedDifference::of(&blocks).unwrap().interval.unwrap();
                inside += usize::from((low..=high).contains(&0.3));
            }
            let part = inside as f64 / f64::from(trials);
            assert!(range.contains(&part), "{correlation}: {part}");
        }
    }
}
