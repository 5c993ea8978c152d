//! Computes the autocorrelation of an innovation sequence at lags 1 to 25, sample by sample, with
//! the bound that 99 % of the coefficients of a white sequence keep.

/// Lags that are looked at, as in the usual whiteness plot.
pub const LAGS: usize = 25;

/// 99.5 % quantile of the standard normal distribution.
const Z_99: f64 = 2.575_829_303_548_901;

/// Autocorrelation over 1 to [`LAGS`] samples, in one pass.
///
/// `r_k = (1/n_k) sum (x_t - m)(x_{t-k} - m) / ((1/n_0) sum (x_t - m)^2)`
///
/// with the mean `m` over all samples and `n_k` pairs. A value that is not finite takes its place
/// in time but is part of no pair.
#[derive(Clone, Debug)]
pub struct Autocorrelation {
    /// First finite value: subtracted before summing, so that a large mean costs no digits.
    origin: Option<f64>,
    samples: f64,
    sum: f64,
    squares: f64,
    /// The last values less the origin, twice in a row so that the window never wraps: the value
    /// `k` samples back is at `end - k`. Zero where none.
    values: [f64; 2 * LAGS],
    /// 1 where there is a value, else 0.
    present: [f64; 2 * LAGS],
    next: usize,
    pairs: [f64; LAGS],
    products: [f64; LAGS],
    sums: [f64; LAGS],
}

impl Default for Autocorrelation {
    fn default() -> Self {
        Self {
            origin: None,
            samples: 0.0,
            sum: 0.0,
            squares: 0.0,
            values: [0.0; 2 * LAGS],
            present: [0.0; 2 * LAGS],
            next: 0,
            pairs: [0.0; LAGS],
            products: [0.0; LAGS],
            sums: [0.0; LAGS],
        }
    }
}

impl Autocorrelation {
    /// Takes the next value of the sequence.
    pub fn push(&mut self, value: f64) {
        let (x, here) = if value.is_finite() {
            (value - *self.origin.get_or_insert(value), 1.0)
        } else {
            (0.0, 0.0)
        };
        self.samples += here;
        self.sum += x;
        self.squares += x * x;
        // Oldest first: index i of the window is lag LAGS - i.
        let window = self.next..self.next + LAGS;
        let past = self.values[window.clone()]
            .iter()
            .zip(&self.present[window]);
        let sums = self
            .pairs
            .iter_mut()
            .zip(&mut self.products)
            .zip(&mut self.sums);
        for ((&then, &there), ((pairs, products), sums)) in past.zip(sums) {
            *pairs += here * there;
            *products += x * then;
            *sums += x * there + then * here;
        }
        for slot in [self.next, self.next + LAGS] {
            self.values[slot] = x;
            self.present[slot] = here;
        }
        self.next = (self.next + 1) % LAGS;
    }

    /// Number of finite values so far.
    pub fn samples(&self) -> u64 {
        self.samples as u64
    }

    /// Mean of the finite values; `None` before the first.
    pub fn mean(&self) -> Option<f64> {
        self.origin.map(|origin| origin + self.sum / self.samples)
    }

    /// `r_1` to `r_25`; `None` for a lag without pairs or a sequence without variance.
    pub fn coefficients(&self) -> [Option<f64>; LAGS] {
        let mean = self.sum / self.samples;
        let variance = self.squares / self.samples - mean * mean;
        std::array::from_fn(|lag| {
            let i = LAGS - 1 - lag;
            let pairs = self.pairs[i];
            let covariance = self.products[i] / pairs - mean * self.sums[i] / pairs + mean * mean;
            (pairs > 0.0 && variance > 0.0).then(|| covariance / variance)
        })
    }

    /// Bound `2.576 / sqrt(n)` that 99 % of the coefficients of a white sequence stay within.
    pub fn bound(&self) -> f64 {
        Z_99 / self.samples.sqrt()
    }

    /// Lags (1 to 25) outside the bound; about one white sequence in five has any.
    pub fn significant_lags(&self) -> Vec<usize> {
        let bound = self.bound();
        (1..=LAGS)
            .zip(self.coefficients())
            .filter(|(_, r)| r.is_some_and(|r| r.abs() > bound))
            .map(|(lag, _)| lag)
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn reference(key: &str) -> Vec<f64> {
        let text = include_str!("../../../tests/reference/metrics.json");
        let json: serde_json::Value = serde_json::from_str(text).unwrap();
        serde_json::from_value(json[key].clone()).unwrap()
    }

    /// The sequence of `tests/reference/metrics.py`.
    fn sequence() -> Vec<f64> {
        let (mut state, mut value) = (12_345_u32, 0.0);
        (0..400)
            .map(|_| {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                value = 0.6 * value + f64::from(state) / 4_294_967_296.0;
                value + 100.0
            })
            .collect()
    }

    #[track_caller]
    fn assert_matches(sequence: &[f64], key: &str) {
        let mut acf = Autocorrelation::default();
        for &x in sequence {
            acf.push(x);
        }
        for (found, expected) in acf.coefficients().iter().zip(&reference(key)[1..]) {
            assert!(
                (found.unwrap() - expected).abs() < 1e-11,
                "{found:?} {expected}"
            );
        }
    }

    #[test]
    fn equals_statsmodels() {
        assert_matches(&sequence(), "whole");
    }

    #[test]
    fn equals_statsmodels_over_gaps() {
        let mut gaps = sequence();
        gaps[50..70].fill(f64::NAN);
        gaps[133] = f64::INFINITY;
        assert_matches(&gaps, "gaps");
    }

    #[test]
    fn coloured_noise_is_distinguished_from_white() {
        let (mut state, mut low) = (1_u64, 0.0);
        let (mut white, mut coloured) = (Autocorrelation::default(), Autocorrelation::default());
        for _ in 0..100_000 {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            let noise = (state >> 40) as f64 - 8_388_608.0;
            low += 0.5 * (noise - low);
            white.push(noise);
            coloured.push(low);
        }
        assert!(white.significant_lags().len() <= 2, "{white:?}");
        assert!((coloured.coefficients()[0].unwrap() - 0.5).abs() < 0.01);
        assert!(coloured.significant_lags().starts_with(&[1, 2, 3, 4]));
        assert!((white.bound() - 0.008_145_5).abs() < 1e-6);
    }

    #[test]
    fn nothing_or_a_constant_has_none() {
        let mut acf = Autocorrelation::default();
        assert_eq!((acf.mean(), acf.coefficients()), (None, [None; LAGS]));
        (0..100).for_each(|_| acf.push(3.5));
        assert_eq!((acf.mean(), acf.coefficients()), (Some(3.5), [None; LAGS]));
    }
}
