//! Detects gauge faults that the innovations of one block hide: tests by chi-squared whether
//! preload and gauge biases (the slow states) have moved from their low-pass of 5 s by more than
//! their random walk allows. Then the loads are reported as contradicted.
//!
//! A gauge that loses a part of its response is explained by other loads, another preload and other
//! biases: in a block of 10 ms the innovations hardly show it, as errors of the model are allowed
//! for. The slow states show it: they leave the place where they were seconds ago, `q = d' (P_r + W
//! tau)^-1 d`, `d = x - x_r`, `x_r` and `P_r` mean and covariance of the slow states with a
//! low-pass of `tau`, `W` their random walk.
//!
//! Source: Bar-Shalom, Li and Kirubarajan 2001, section 5.4: consistency of innovations over many
//! steps.

use serde::{Deserialize, Serialize};

use crate::bearing::Tuning;
use crate::bearing::bias_prior::BiasPrior;

/// Time over which the slow states are compared [s]: loads pass their range within seconds, a
/// bearing warms within tens.
const HORIZON_S: f32 = 5.0;

/// Chi-squared of five degrees of freedom that chance exceeds once in 70 000.
const CONTRADICTED: f32 = 30.0;

/// Time without a contradiction after which a reference names a gauge (s): one that was taken right
/// after a start may be off itself.
const PROVEN_S: f32 = 6.0;

/// Chi-squared of five degrees of freedom below which slow states have settled; chance exceeds it
/// once in 64. While a gauge loses its gain slowly, the gate would exclude another one.
const SETTLED: f32 = 14.0;

/// Low-pass of the slow states, and whether they have moved from it faster than they can.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Consistency {
    reference: Option<BiasPrior>,
    contradicted: bool,
    /// Squared distance from the reference.
    distance: f32,
    /// Time without a contradiction (s).
    proven_s: f32,
}

impl Consistency {
    /// Takes in the slow states of a block of `dt_s`; `valid`: whether the hypothesis that has them
    /// stands otherwise.
    ///
    /// The reference stays while it is contradicted: slow states come back when the cause has gone.
    pub fn update(&mut self, slow: &BiasPrior, valid: bool, tuning: &Tuning, dt_s: f32) {
        let Some(reference) = &mut self.reference else {
            self.reference = valid.then_some(*slow);
            return;
        };
        let distance = reference.distance(slow, tuning, HORIZON_S);
        // A distance that is no number is none that chance explains.
        self.distance = distance.unwrap_or(f32::MAX);
        self.contradicted = !distance.is_some_and(|distance| distance <= CONTRADICTED);
        if !self.contradicted {
            self.proven_s += dt_s;
            reference.follow(slow, (dt_s / HORIZON_S).min(1.0));
        }
    }

    /// The slow states before a contradiction, where they stood for long enough to isolate its
    /// cause by them.
    pub fn proven(&self) -> Option<BiasPrior> {
        (self.contradicted && self.proven_s > PROVEN_S)
            .then_some(self.reference)
            .flatten()
    }

    /// The slow states of the last seconds without a contradiction.
    pub fn reference(&self) -> Option<BiasPrior> {
        self.reference
    }

    /// Whether the slow states are where they were seconds ago.
    pub fn is_settled(&self) -> bool {
        self.reference.is_some() && !self.contradicted && self.distance < SETTLED
    }

    /// Ends the contradiction, as its cause is left out.
    pub fn resolve(&mut self) {
        self.contradicted = false;
        self.distance = 0.0;
    }

    /// Whether a sensor contradicts the others: the load that explains both is not valid.
    pub fn is_contradicted(&self) -> bool {
        self.contradicted
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bearing::LOADS;

    const DT_S: f32 = 0.01;

    fn tuning() -> Tuning {
        Tuning {
            slip_time_s: 1.0,
            slip_std: 0.004,
            slip_limit: 0.06,
            phase_walk: 0.01,
            load_mean: [0.0; LOADS],
            load_factor: [[0.0; LOADS]; LOADS],
            load_time_s: 0.4,
            preload_std: 1.0,
            preload_walk: 0.2,
            bias_std: 15.0,
            bias_time_s: 8200.0,
            bulk_std: 3.0,
            lowest_hz: 10.0,
        }
    }

    /// Seconds after which a preload [um] and a bias [um/m] that move at these rates are
    /// contradicted; 60 at most.
    fn contradicted_after(preload: f32, bias: f32) -> Option<f32> {
        let tuning = tuning();
        let start = BiasPrior::known(&[0.0, 1.0, 2.0, 3.0, 4.0], &[0.5, 4.0, 4.0, 4.0, 4.0]);
        let mut consistency = Consistency::default();
        consistency.update(&start, true, &tuning, DT_S);
        (1..6000).map(|k| DT_S * k as f32).find(|t| {
            let slow = start.moved(&[preload * t, 0.0, bias * t, 0.0, 0.0]);
            consistency.update(&slow, true, &tuning, DT_S);
            consistency.is_contradicted()
        })
    }

    #[test]
    fn heat_moves_the_slow_states_and_a_loose_gauge_moves_them_faster() {
        // A bearing that warms by half of its preload in 40 s, its gauges by 20 um/m a minute.
        assert_eq!(contradicted_after(0.2, 0.3), None);
        assert!(contradicted_after(3.0, 0.0).is_some_and(|s| s < 2.0));
        assert!(contradicted_after(0.0, 20.0).is_some_and(|s| s < 2.0));
    }

    #[test]
    fn what_is_contradicted_ends_with_its_cause() {
        let tuning = tuning();
        let start = BiasPrior::known(&[0.0; 5], &[0.5, 4.0, 4.0, 4.0, 4.0]);
        let mut consistency = Consistency::default();
        consistency.update(&start, false, &tuning, DT_S);
        consistency.update(&start, true, &tuning, DT_S);
        for _ in 0..6000 {
            let slow = start.moved(&[-6.0, 0.0, 0.0, 0.0, 0.0]);
            consistency.update(&slow, true, &tuning, DT_S);
            assert!(consistency.is_contradicted());
        }
        consistency.update(&start, true, &tuning, DT_S);
        assert!(!consistency.is_contradicted());
    }
}
