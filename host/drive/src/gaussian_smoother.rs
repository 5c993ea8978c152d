//! Smooths regular or irregular samples with Gaussian weights: local mean (half power at the
//! cut-off), local cubic fit with two derivatives (weighted Savitzky-Golay) and its noise gain.
//! Zero-phase except at the ends.

/// Width of a Gaussian that passes `cutoff_hz` with half the power, times the cut-off:
/// `sqrt(ln 2) / (2 pi)`.
const WIDTH: f64 = 0.132_504;

/// Half the length of the kernel, in widths.
const REACH: f64 = 4.0;

/// A zero-phase low-pass: weights `exp(-(t - t0)^2 / (2 sigma^2))`, half power
/// at the cut-off. Sampling may be irregular; a NaN is a missing sample.
#[derive(Clone, Copy, Debug)]
pub struct Smoother {
    sigma_s: f64,
}

impl Smoother {
    /// The low-pass with its cut-off [Hz]. An infinite one passes every sample as it is.
    pub fn new(cutoff_hz: f64) -> Self {
        Self {
            sigma_s: WIDTH / cutoff_hz,
        }
    }

    /// Time that an end of a recording is felt into it [s].
    pub fn reach_s(self) -> f64 {
        REACH * self.sigma_s
    }

    /// The signal's weighted mean about sample `at`.
    pub fn mean(self, t: &[f64], x: &[f64], at: usize) -> f64 {
        let (mut sum, mut total) = (0.0, 0.0);
        self.around(t, at, |i, _, w| {
            if x[i].is_finite() {
                sum += w * x[i];
                total += w;
            }
        });
        sum / total
    }

    /// Value and first two derivatives of the cubic that fits the signal best
    /// about sample `at`, in the weights of the low-pass; NaN where fewer than
    /// 5 samples are near.
    ///
    /// A symmetric window makes the estimates free of delay, a one-sided one (at
    /// the ends) leaves them unbiased up to the third derivative.
    pub fn cubic(self, t: &[f64], x: &[f64], at: usize) -> [f64; 3] {
        let mut moments = [0.0; 7];
        let mut right = [0.0; 4];
        let mut count = 0;
        let origin = x[at];
        self.around(t, at, |i, u, w| {
            let y = x[i] - origin;
            if y.is_finite() {
                count += 1;
                let mut power = w;
                for (k, moment) in moments.iter_mut().enumerate() {
                    *moment += power;
                    if k < 4 {
                        right[k] += power * y;
                    }
                    power *= u;
                }
            }
        });
        let Some(c) = (count >= 5).then(|| solve(&moments, right)).flatten() else {
            return [f64::NAN; 3];
        };
        let s = self.sigma_s;
        [origin + c[0], c[1] / s, 2.0 * c[2] / (s * s)]
    }

    /// Standard deviation of [`Self::cubic`]'s value where that of white noise is 1, of samples
    /// `period_s` apart.
    pub fn noise_gain(self, period_s: f64) -> f64 {
        let half = (self.reach_s() / period_s).ceil().max(2.0) as usize;
        let t: Vec<f64> = (0..=2 * half).map(|i| i as f64 * period_s).collect();
        let mut impulse = vec![0.0; t.len()];
        let mut square = 0.0;
        for i in 0..t.len() {
            impulse[i] = 1.0;
            let [value, ..] = self.cubic(&t, &impulse, half);
            square += value * value;
            impulse[i] = 0.0;
        }
        square.sqrt()
    }

    /// Shows index, scaled time and weight of each sample near `at`.
    fn around(self, t: &[f64], at: usize, mut each: impl FnMut(usize, f64, f64)) {
        let near = |i: &usize| (t[*i] - t[at]).abs() <= self.reach_s();
        let before = (0..at).rev().take_while(near);
        for i in before.chain((at..t.len()).take_while(near)) {
            let u = if i == at {
                0.0
            } else {
                (t[i] - t[at]) / self.sigma_s
            };
            each(i, u, (-0.5 * u * u).exp());
        }
    }
}

/// Solves the normal equations of a cubic by elimination; they are well scaled,
/// as time is counted in widths.
fn solve(moments: &[f64; 7], right: [f64; 4]) -> Option<[f64; 4]> {
    let mut a = [[0.0; 5]; 4];
    for i in 0..4 {
        a[i][..4].copy_from_slice(&moments[i..i + 4]);
        a[i][4] = right[i];
    }
    for i in 0..4 {
        let pivot = a[i][i];
        if pivot <= 1e-9 * moments[2 * i] {
            return None;
        }
        for k in i + 1..4 {
            let factor = a[k][i] / pivot;
            for j in i..5 {
                a[k][j] -= factor * a[i][j];
            }
        }
    }
    let mut c = [0.0; 4];
    for i in (0..4).rev() {
        let known: f64 = (i + 1..4).map(|j| a[i][j] * c[j]).sum();
        c[i] = (a[i][4] - known) / a[i][i];
    }
    Some(c)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// Irregular steps, a missing sample and the end: a cubic is exact everywhere.
    #[test]
    fn a_cubic_is_its_own_fit() {
        let t: Vec<f64> = (0..200)
            .map(|i| f64::from(i) * 1e-3 + 2e-4 * f64::from(i % 3))
            .collect();
        let f = |t: f64| 3.0 - 2.0 * t + 40.0 * t * t - 100.0 * t * t * t;
        let mut x: Vec<f64> = t.iter().map(|t| f(*t)).collect();
        x[50] = f64::NAN;
        let smoother = Smoother::new(20.0);
        for at in [0, 3, 52, 100, 199] {
            let [value, speed, acceleration] = smoother.cubic(&t, &x, at);
            let (s, t) = (t[at], t[at]);
            assert!((value - f(s)).abs() < 1e-9, "{at}");
            assert!(
                (speed - (-2.0 + 80.0 * t - 300.0 * t * t)).abs() < 1e-6,
                "{at}"
            );
            assert!((acceleration - (80.0 - 600.0 * t)).abs() < 1e-4, "{at}");
        }
    }

    /// Half the power, so `1 / sqrt 2` of the amplitude, at the cut-off.
    #[test]
    fn the_cutoff_passes_half_the_power() {
        let t: Vec<f64> = (0..4000).map(|i| f64::from(i) * 1e-3).collect();
        let x: Vec<f64> = t
            .iter()
            .map(|t| (std::f64::consts::TAU * 10.0 * t).sin())
            .collect();
        let smoother = Smoother::new(10.0);
        let power: f64 = (1000..3000)
            .map(|at| smoother.mean(&t, &x, at).powi(2))
            .sum::<f64>()
            / 2000.0;
        assert!((power - 0.25).abs() < 0.002, "{power}");
    }

    /// Between the mean of all samples in the kernel and a single sample; against the deviation of
    /// smoothed noise.
    #[test]
    fn noise_is_smoothed_by_its_gain() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut uniform = || random.random_range(-0.5..0.5);
        let t: Vec<f64> = (0..6000).map(|i| f64::from(i) * 1e-3).collect();
        let x: Vec<f64> = t.iter().map(|_| uniform() * 12.0_f64.sqrt()).collect();
        for cutoff_hz in [20.0, 80.0] {
            let smoother = Smoother::new(cutoff_hz);
            let square: f64 = (500..5500)
                .map(|at| smoother.cubic(&t, &x, at)[0].powi(2))
                .sum::<f64>();
            let ratio = (square / 5000.0).sqrt() / smoother.noise_gain(1e-3);
            assert!((ratio - 1.0).abs() < 0.05, "{cutoff_hz} {ratio}");
        }
    }

    #[test]
    fn an_infinite_cutoff_passes_every_sample() {
        let (t, x) = ([0.0, 1.0, 2.0], [1.0, 5.0, -3.0]);
        let smoother = Smoother::new(f64::INFINITY);
        assert_eq!(smoother.mean(&t, &x, 1), 5.0);
    }
}
