//! Estimates the model error of a rotor from how its unbalance changes with the speed
//! (`UnbalanceConsistency`): the true unbalance is the same at every speed, the estimated one moves
//! with the error of the model.
//!
//! At one speed, an unbalance takes up what the model errs by, and no innovation shows it. Station
//! `k` is a speed that was passed. It gives the unbalance `u_k = R(-angle) f / speed^2`, the variance
//! `N_k` of each of its components, and the change `e_k` of `u` where the model errs by its usual tolerances, from the
//! image. With means over the stations weighted by `w_k`, the model error in usual tolerances is
//!
//! `tau^2 = (sum w |u - mean u|^2 - 2 sum w N + c) / (sum w (e - mean e)^2 + c / tau_0^2)`
//!
//! where the second sum leaves out the first station. `w_k = 1 / (N_k + p (tau e_k)^2)` with `tau` before the station:
//! a part `p` of the error does not follow `e`, but shrinks with `tau`. The prior is `tau_0` = 1 usual tolerance, of
//! `c` = 2 degrees of freedom, those of one unbalance. Without a change of speed nothing is known, and nothing is said.
//!
//! Source: Gelman et al., Bayesian Data Analysis, 3rd edition (2013), section 2.6: scaled inverse chi-squared prior of
//! a variance.

use serde::{Deserialize, Serialize};

use crate::io::estimate::{Estimate, MAX_LOADS};
use crate::rotor::filter::FORCES;
use crate::rotor::{RotorEstimator, RotorState};

/// Pairs of forces.
const PAIRS: usize = FORCES / 2;

/// Steps of the image's tables between stations: the usual error changes little within.
const SPACING: f32 = 0.25;

/// Degrees of freedom of one unbalance, `c`.
const DEGREES: f32 = 2.0;

/// Part of the variance of the model's error at a speed that does not follow `e` from speed to speed, `p`: bearings,
/// damping and shaft err each for themselves, and each has its own course over the speed.
const OWN_PART: f32 = 0.5;

/// Part of the evidence that is left after another station: 256 stations are looked back on, four passes of a table of
/// 17 speeds.
const KEPT: f32 = 1.0 - 1.0 / 256.0;

/// An estimated unbalance at a speed, in the image's scale of forces over (rad/s)^2.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Unbalance {
    /// In the frame that turns with the shaft, `u`.
    pub value: [f32; 2],
    /// Change where the model errs by its usual tolerances, `e`.
    pub usual_error: f32,
    /// Of each component, `N`.
    pub variance: f32,
}

/// Weighted sums of one pair.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
struct Sums {
    weight: f32,
    mean: [f32; 2],
    mean_error: f32,
    /// `sum w N` after the first station.
    noise: f32,
    /// `sum w |u - mean u|^2`.
    spread: f32,
    /// `sum w (e - mean e)^2`.
    error_spread: f32,
}

impl Sums {
    /// Takes in an unbalance where the model is known to `tolerance`.
    ///
    /// Source: West, Updating mean and variance estimates, Communications of the ACM 22 (1979).
    fn push(&mut self, unbalance: &Unbalance, tolerance: f32) {
        let Unbalance {
            value,
            usual_error,
            variance,
        } = unbalance;
        let error = tolerance * usual_error;
        let weight = 1.0 / (variance + OWN_PART * (error * error));
        let known = weight > 0.0 && weight.is_finite() && usual_error.is_finite();
        if !known || !value.iter().all(|x| x.is_finite()) {
            return;
        }
        if self.weight > 0.0 {
            self.noise = KEPT * self.noise + weight * variance;
        }
        let before = KEPT * self.weight;
        self.weight = before + weight;
        let (part, spread) = (weight / self.weight, weight * before / self.weight);
        let (dx, dy) = (value[0] - self.mean[0], value[1] - self.mean[1]);
        let de = usual_error - self.mean_error;
        self.mean[0] += part * dx;
        self.mean[1] += part * dy;
        self.mean_error += part * de;
        self.spread = KEPT * self.spread + spread * (dx * dx + dy * dy);
        self.error_spread = KEPT * self.error_spread + spread * (de * de);
    }
}

/// The evidence of the stations so far.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct UnbalanceConsistency {
    /// Of the last station, in steps of the tables.
    place: Option<f32>,
    pairs: [Sums; PAIRS],
    /// `tau`; 0 while the speed has not changed, or where no pair turns.
    tolerance: f32,
}

impl UnbalanceConsistency {
    /// Whether the speed at this `place`, in steps of the tables, is another station.
    pub fn is_due(&self, place: f32) -> bool {
        self.place
            .is_none_or(|last| (place - last).abs() >= SPACING)
    }

    /// Takes in the unbalances of a station; none for a pair that does not turn.
    #[cold]
    pub fn push(&mut self, place: f32, unbalances: [Option<Unbalance>; PAIRS]) {
        let first = self.place.is_none();
        let prior = self.tolerance == 0.0;
        let tolerance = if prior { 1.0 } else { self.tolerance };
        self.place = Some(place);
        for (sums, unbalance) in self.pairs.iter_mut().zip(&unbalances) {
            if let Some(unbalance) = unbalance {
                sums.push(unbalance, tolerance);
            }
        }
        let turning = self.pairs.iter().any(|sums| sums.weight > 0.0);
        if !first && turning {
            self.tolerance = self.evaluate();
        }
    }

    /// The frame that turns with the shaft is turned by an angle of this cosine and sine, as homing does.
    pub fn rotate(&mut self, cosine: f32, sine: f32) {
        for Sums { mean: [x, y], .. } in &mut self.pairs {
            (*x, *y) = (cosine * *x + sine * *y, cosine * *y - sine * *x);
        }
    }

    /// Model error that the stations allow, `tau`, in usual tolerances; 0 while the speed has not changed, and where no
    /// pair turns.
    pub fn tolerance(&self) -> f32 {
        self.tolerance
    }

    fn evaluate(&self) -> f32 {
        let (mut spread, mut error_spread) = (0.0, 0.0);
        for sums in &self.pairs {
            spread += sums.spread - DEGREES * sums.noise;
            error_spread += sums.error_spread;
        }
        let spread = if spread > 0.0 { spread } else { 0.0 };
        libm::sqrtf((spread + DEGREES) / (error_spread + DEGREES))
    }
}

impl<const NZ: usize, const NX: usize> RotorEstimator<'_, NZ, NX> {
    /// Takes in the unbalances at another speed, of a sample that used every sensor.
    pub(super) fn compare_unbalances(&self, state: &mut RotorState<NZ, NX>, estimate: &Estimate) {
        let place = state.scheduled.place();
        if !state.consistency.is_due(place) || state.clean_samples == 0 || !state.shaft.is_settled()
        {
            return;
        }
        let unbalances = self.unbalances(state, estimate);
        state.consistency.push(place, unbalances);
    }

    /// The unbalance of each pair that turns.
    #[cold]
    fn unbalances(
        &self,
        state: &RotorState<NZ, NX>,
        estimate: &Estimate,
    ) -> [Option<Unbalance>; FORCES / 2] {
        let speed = self.speed(state);
        let late = self.lag() as f32 * speed * self.model.sample_s;
        let angle = estimate.angle_rad - late;
        let (cosine, sine) = (libm::cosf(angle), libm::sinf(angle));
        let per_square = 1.0 / (speed * speed);
        let tolerance = self.noise(state).tolerance;
        let mut unbalances = [None; FORCES / 2];
        for (k, unbalance) in unbalances.iter_mut().enumerate() {
            let forces = self.state(state).get(2 * NZ + 2 * k..2 * NZ + 2 * k + 2);
            let (Some([x, y]), true) = (forces, self.turns(k)) else {
                continue;
            };
            let of = |j: usize| {
                let deviation = self.deviation(state, 2 * k + j);
                let error = state.scheduled.load_error[(2 * k + j) % MAX_LOADS];
                let model = tolerance * error;
                (deviation * deviation - model * model, error * error)
            };
            let ((own_x, error_x), (own_y, error_y)) = (of(0), of(1));
            *unbalance = Some(Unbalance {
                value: [
                    per_square * (cosine * x + sine * y),
                    per_square * (cosine * y - sine * x),
                ],
                usual_error: per_square * libm::sqrtf(error_x + error_y),
                variance: per_square * per_square * (0.5 * (own_x + own_y)),
            });
        }
        unbalances
    }

    /// Whether pair `k` of forces turns with the shaft.
    fn turns(&self, k: usize) -> bool {
        k < self.constant.pairs && self.constant.synchronous_mask & (1 << k) != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of an unbalance (3, -4), and an error that grows twentyfold from the first to the last of `count` stations, of
    /// which the model has `tau`.
    fn passed(tau: f32, count: usize) -> UnbalanceConsistency {
        let mut consistency = UnbalanceConsistency::default();
        for k in 0..count {
            let place = SPACING * k as f32;
            let usual_error = 0.1 + 1.9 * k as f32 / (count - 1) as f32;
            assert!(consistency.is_due(place));
            let unbalance = Unbalance {
                value: [3.0, -4.0 + tau * usual_error],
                usual_error,
                variance: 1e-4,
            };
            consistency.push(place, [Some(unbalance), None]);
            assert!(!consistency.is_due(place + 0.9 * SPACING));
        }
        consistency
    }

    #[test]
    fn before_the_speed_changes_nothing_is_said_then_the_prior() {
        let mut consistency = UnbalanceConsistency::default();
        let unbalance = Unbalance {
            value: [3.0, -4.0],
            usual_error: 1.0,
            variance: 1e-4,
        };
        consistency.push(0.0, [Some(unbalance); 2]);
        assert_eq!(consistency.tolerance(), 0.0);
        consistency.push(1.0, [Some(unbalance); 2]);
        assert!((consistency.tolerance() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn an_unbalance_that_stays_confirms_the_model_and_one_that_moves_shows_its_error() {
        let found = passed(0.0, 60).tolerance();
        assert!(found < 0.03, "{found}");
        for tau in [0.5, 1.0, 3.0] {
            let found = passed(tau, 60).tolerance();
            assert!((found / tau - 1.0).abs() < 0.15, "{tau}: {found}");
        }
    }

    #[test]
    fn noise_of_the_unbalance_is_no_error_of_the_model() {
        let mut consistency = UnbalanceConsistency::default();
        for k in 0..200 {
            let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
            let unbalance = Unbalance {
                value: [3.0 + 0.5 * sign, 0.5 * sign],
                usual_error: if k % 4 < 2 { 0.1 } else { 2.0 },
                variance: 0.25,
            };
            consistency.push(k as f32, [Some(unbalance), None]);
        }
        assert!(consistency.tolerance() < 0.2, "{consistency:?}");
    }

    #[test]
    fn homing_turns_the_unbalance_seen_so_far() {
        let mut consistency = UnbalanceConsistency::default();
        let mut unbalance = Unbalance {
            value: [1.0, 0.0],
            usual_error: 0.5,
            variance: 1e-4,
        };
        consistency.push(0.0, [Some(unbalance), None]);
        consistency.rotate(0.0, 1.0);
        unbalance.value = [0.0, -1.0];
        unbalance.usual_error = 1.5;
        consistency.push(1.0, [Some(unbalance), None]);
        assert!(consistency.pairs[0].spread < 1e-6, "{consistency:?}");
    }

    #[test]
    fn numbers_that_are_none_change_nothing() {
        let mut consistency = passed(1.0, 20);
        let before = consistency.tolerance();
        for value in [f32::NAN, f32::INFINITY] {
            let unbalance = Unbalance {
                value: [value; 2],
                usual_error: value,
                variance: value,
            };
            consistency.push(100.0, [Some(unbalance); 2]);
        }
        assert_eq!(consistency.tolerance(), before);
    }
}
