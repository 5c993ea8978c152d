//! Rauch-Tung-Striebel smoother that removes the noise of a load estimate, for a load that moves as
//! a random walk; and estimation of the variance of its steps.

/// Samples that are smoothed at once, at most.
const BLOCK: usize = 1 << 16;

/// Part of its influence that a later sample has where smoothing may be cut.
const FORGOTTEN: f64 = 1e-9;

/// A load and the variance of its error, as a filter gave them for one sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The load.
    pub load: f64,
    /// Variance of its error (square of its unit).
    pub variance: f64,
}

/// Variance of the steps of a load from sample to sample, found from its estimates.
///
/// The estimates of a random walk move by `K nu` a sample, so that
/// `E (x_t - x_{t-1})^2 = P^-_t - P_t = q + P_{t-1} - P_t`. The mean of all
/// samples gives q.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StepVariance {
    sum: f64,
    steps: u64,
    last: Option<Estimate>,
}

impl StepVariance {
    /// Takes the next sample; none where it is not valid.
    pub fn push(&mut self, estimate: Option<Estimate>) {
        if let (Some(last), Some(now)) = (self.last, estimate) {
            self.sum += (now.load - last.load).powi(2) + now.variance - last.variance;
            self.steps += 1;
        }
        self.last = estimate;
    }

    /// Adds the steps of another file.
    pub fn add(&mut self, other: &Self) {
        self.sum += other.sum;
        self.steps += other.steps;
    }

    /// q (square of the load's unit); none without two samples in a row.
    pub fn mean(&self) -> Option<f64> {
        (self.steps > 0).then(|| (self.sum / self.steps as f64).max(0.0))
    }
}

/// Rauch-Tung-Striebel smoother of a load that moves as a random walk.
///
/// Backwards from the last sample of a part without gaps, with `c = P_t / (P_t + q)`:
/// `x_t|T = x_t + c (x_{t+1}|T - x_t)`, `P_t|T = P_t + c^2 (P_{t+1}|T - P_t - q)`.
///
/// Source: Rauch, Tung, Striebel, Maximum likelihood estimates of linear dynamic systems, 1965.
#[derive(Clone, Debug, PartialEq)]
pub struct Smoother {
    step_variance: f64,
    waiting: Vec<Estimate>,
    variance_sum: f64,
    samples: u64,
}

impl Smoother {
    /// For steps of the variance q, see [`StepVariance`].
    pub fn new(step_variance: f64) -> Self {
        Self {
            step_variance,
            waiting: Vec::new(),
            variance_sum: 0.0,
            samples: 0,
        }
    }

    /// Takes the next sample, none where it is not valid; gives smoothed loads of samples before.
    pub fn push(&mut self, estimate: Option<Estimate>, smoothed: impl FnMut(f64)) {
        match estimate {
            None => self.end(smoothed),
            Some(estimate) => {
                self.waiting.push(estimate);
                if self.waiting.len() >= 2 * BLOCK {
                    let keep = self.remembered().min(BLOCK);
                    self.smooth(keep, smoothed);
                }
            }
        }
    }

    /// Gives all smoothed loads up to the last sample.
    pub fn end(&mut self, smoothed: impl FnMut(f64)) {
        self.smooth(0, smoothed);
    }

    /// Mean variance of the smoothed loads given so far; none before the first.
    pub fn variance(&self) -> Option<f64> {
        (self.samples > 0).then(|| self.variance_sum / self.samples as f64)
    }

    /// Adds the smoothed loads of a later file.
    pub fn append(&mut self, later: &Self) {
        self.variance_sum += later.variance_sum;
        self.samples += later.samples;
    }

    fn gain(&self, variance: f64) -> f64 {
        let sum = variance + self.step_variance;
        if sum > 0.0 { variance / sum } else { 0.0 }
    }

    /// Samples at the end that later ones can still change.
    fn remembered(&self) -> usize {
        let mut influence = 1.0;
        let recent = self.waiting.iter().rev().take_while(|estimate| {
            influence *= self.gain(estimate.variance);
            influence > FORGOTTEN
        });
        recent.count() + 1
    }

    /// Smooths all that waits and gives it but for the last `keep` samples.
    fn smooth(&mut self, keep: usize, mut smoothed: impl FnMut(f64)) {
        let mut later: Option<Estimate> = None;
        let mut loads = Vec::with_capacity(self.waiting.len());
        for now in self.waiting.iter().rev() {
            let c = self.gain(now.variance);
            let estimate = later.map_or(*now, |later| Estimate {
                load: now.load + c * (later.load - now.load),
                variance: now.variance
                    + c * c * (later.variance - now.variance - self.step_variance),
            });
            loads.push(estimate);
            later = Some(estimate);
        }
        let given = self.waiting.len().saturating_sub(keep);
        for estimate in loads.iter().rev().take(given) {
            self.variance_sum += estimate.variance;
            self.samples += 1;
            smoothed(estimate.load);
        }
        self.waiting.drain(..given);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const STEP: f64 = 2.0;
    const NOISE: f64 = 10.0;

    /// A normal number, by the sum of twelve uniform ones.
    fn normal(rng: &mut ChaCha8Rng) -> f64 {
        (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0
    }

    /// A random walk and its estimates by a Kalman filter, from unknown.
    fn walk(samples: usize) -> (Vec<f64>, Vec<Estimate>) {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let (mut load, mut estimate) = (0.0, 0.0);
        let mut variance = 1e6;
        let mut walk = (Vec::new(), Vec::new());
        for _ in 0..samples {
            load += STEP * normal(&mut rng);
            let prior = variance + STEP * STEP;
            let gain = prior / (prior + NOISE * NOISE);
            estimate += gain * (load + NOISE * normal(&mut rng) - estimate);
            variance = (1.0 - gain) * prior;
            walk.0.push(load);
            walk.1.push(Estimate {
                load: estimate,
                variance,
            });
        }
        walk
    }

    #[test]
    fn the_error_is_as_small_as_the_smoother_states() {
        let (loads, estimates) = walk(300_000);
        let mut steps = StepVariance::default();
        for &estimate in &estimates {
            steps.push(Some(estimate));
        }
        let q = steps.mean().unwrap();
        assert!((q / (STEP * STEP) - 1.0).abs() < 0.02, "{q}");
        let mut smoother = Smoother::new(q);
        let mut smoothed = Vec::new();
        for &estimate in &estimates {
            smoother.push(Some(estimate), |load| smoothed.push(load));
        }
        assert!(smoothed.len() > BLOCK && smoothed.len() < loads.len());
        smoother.end(|load| smoothed.push(load));
        let square = |error: f64| error * error;
        let of = |found: &mut dyn Iterator<Item = f64>| {
            found
                .zip(&loads)
                .map(|(x, load)| square(x - load))
                .sum::<f64>()
                / loads.len() as f64
        };
        let error = of(&mut smoothed.iter().copied());
        let filtered = of(&mut estimates.iter().map(|estimate| estimate.load));
        assert!(
            (error / smoother.variance().unwrap() - 1.0).abs() < 0.03,
            "{error}"
        );
        assert!(error < 0.6 * filtered, "{error} {filtered}");
        // In one block.
        let mut at_once = Smoother::new(q);
        at_once.waiting.clone_from(&estimates);
        let mut expected = Vec::new();
        at_once.end(|load| expected.push(load));
        let differs = |(a, b): (&f64, &f64)| (a - b).abs() > 1e-6;
        assert!(!smoothed.iter().zip(&expected).any(differs));
    }

    #[test]
    fn parts_between_gaps_are_smoothed_apart() {
        let mut smoother = Smoother::new(1.0);
        let mut found = Vec::new();
        for (load, is_last) in [(0.0, false), (4.0, true), (100.0, true)] {
            let estimate = Estimate {
                load,
                variance: 1.0,
            };
            smoother.push(Some(estimate), |load| found.push(load));
            if is_last {
                smoother.push(None, |load| found.push(load));
            }
        }
        assert_eq!(found, [2.0, 4.0, 100.0]);
        assert_eq!(Smoother::new(0.0).variance(), None);
    }
}
