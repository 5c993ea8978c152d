//! Generates the simulated bending load that gauges read in addition to torque, sample by sample: a
//! first-order Gauss-Markov process with standard deviation and time constant of the description.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use loadtwin_machine::Drift;

/// `L+ = a L + w`, `a = exp(-dt / time_s)`, `var w = std^2 (1 - a^2)`.
pub(crate) struct BendingLoad {
    left: f64,
    spread: f64,
    value: f64,
    rng: ChaCha8Rng,
}

impl BendingLoad {
    /// Where the long run has left it.
    pub(crate) fn new(described: &Drift, dt: f64, mut rng: ChaCha8Rng) -> Self {
        let left = (-dt / described.time_s).exp();
        Self {
            left,
            spread: described.std * (1.0 - left * left).sqrt(),
            value: described.std * rng.sample::<f64, _>(StandardNormal),
            rng,
        }
    }

    /// The load in the next sample.
    pub(crate) fn next(&mut self) -> f64 {
        self.value =
            self.left * self.value + self.spread * self.rng.sample::<f64, _>(StandardNormal);
        self.value
    }
}
