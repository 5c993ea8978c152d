//! Estimates the white noise of each recorded column of a drive by third differences, and defines
//! the levels by which its estimator is tuned (`Levels`): this noise, and the RMS of the drive and
//! of the model error.

use crate::smoothed_motion::Motion;

/// Levels that an estimator is tuned by.
pub struct Levels {
    /// RMS of the drive [its unit].
    pub nominal: f64,
    /// RMS of what is unexplained of recordings or blocks left out [the drive's unit].
    pub model_std: f64,
    /// Columns with the standard deviation of their white noise [the column's unit].
    pub noise: Vec<(String, f64)>,
}

/// Standard deviation of white noise beside a signal that is smooth over four samples: the third
/// difference of white noise has 20 times its variance. The median over blocks of 64 keeps steps
/// and reversals out; none of fewer than four values.
pub fn white_noise_std(values: &[f64]) -> Option<f64> {
    let thirds: Vec<f64> = (values.array_windows())
        .map(|[a, b, c, d]| (d - a) - 3.0 * (c - b))
        .filter(|x| x.is_finite())
        .collect();
    let mut powers: Vec<f64> = (thirds.chunks(64))
        .map(|block| block.iter().map(|x| x * x).sum::<f64>() / block.len() as f64)
        .collect();
    powers.sort_by(f64::total_cmp);
    let median = powers.get(powers.len() / 2)?;
    Some((median / 20.0).sqrt())
}

/// The RMS over recordings of each column's noise.
pub fn noise(motions: &[Motion]) -> Vec<(String, f64)> {
    let Some(first) = motions.first() else {
        return Vec::new();
    };
    let of = |k: usize| {
        let powers = motions
            .iter()
            .filter_map(|m| m.noise.get(k))
            .map(|(_, std)| std * std);
        (powers.sum::<f64>() / motions.len() as f64).sqrt()
    };
    let columns = first.noise.iter().enumerate();
    columns
        .map(|(k, (name, _))| (name.clone(), of(k)))
        .filter(|(_, std)| *std > 0.0)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    #[test]
    fn noise_is_found_beside_a_motion_and_a_step() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut uniform = || random.random_range(-0.5..0.5);
        let values: Vec<f64> = (0..4000)
            .map(|i| {
                let step = if i > 2222 { 50.0 } else { 0.0 };
                100.0 * (0.01 * f64::from(i)).sin() + step + 0.3 * uniform()
            })
            .collect();
        let std = white_noise_std(&values).unwrap();
        assert!((std / (0.3 / 12.0_f64.sqrt()) - 1.0).abs() < 0.1, "{std}");
        assert_eq!(white_noise_std(&values[..3]), None);
    }
}
