//! Reports the loads of the rotor estimator with standard deviations and faults, for the sample
//! that the estimate is of, which may lag. Also gives its noise level, allowed model error,
//! covariance, state and speed.

use crate::io::estimate::{Estimate, LoadEstimate, MAX_LOADS};
use crate::io::fault::Fault;
use crate::rotor::filter::FORCES;
use crate::rotor::fixed_lag_smoother::LaggedState;
use crate::rotor::{MARGIN, RotorEstimator, RotorState};

/// Probability that a start which only the highest level explains is one of wrong sensors: rotors that are as far off
/// as that level allows for are more frequent than two wrong sensors.
const SENSORS_AT_FAULT: f32 = 0.25;

impl<const NZ: usize, const NX: usize> RotorEstimator<'_, NZ, NX> {
    /// Index of the noise level in use; 0 is that of the description.
    pub fn level(&self, state: &RotorState<NZ, NX>) -> u8 {
        state.mismatch.level()
    }

    /// Model error that is allowed for, in the usual tolerances.
    pub fn tolerance(&self, state: &RotorState<NZ, NX>) -> f32 {
        let allowed = usize::from(state.mismatch.allowed());
        let of_level = (self.model.levels.get(allowed)).map_or(0.0, |noise| noise.tolerance);
        let of_speeds = state.consistency.tolerance();
        // A call of `max` takes more instructions.
        if of_level > of_speeds {
            of_level
        } else {
            of_speeds
        }
    }

    /// Covariance of the state by rows, in the image's scale, while the gain is recursive.
    pub fn covariance<'s>(&self, state: &'s RotorState<NZ, NX>) -> Option<&'s [f32]> {
        let steady = state.clean_samples >= self.noise(state).full_samples && state.age == 0;
        (!steady).then_some(state.posterior.covariance.as_flattened())
    }

    pub(crate) fn loads(&self, state: &RotorState<NZ, NX>, estimate: &mut Estimate) {
        let lag = self.lag();
        let beyond = self.tolerance(state) - self.noise(state).tolerance;
        let speeds = &self.model.speeds;
        let range = f32::from(speeds.count - 1) * speeds.step;
        let margin = MARGIN * (speeds.lowest + range);
        let inside = [state.shaft.speed, self.speed(state)].iter().all(|speed| {
            *speed >= speeds.lowest - margin && *speed <= speeds.lowest + range + margin
        });
        let untested = self.model.levels.len() > 1 && !state.mismatch.is_tested();
        let unsettled = Self::silent(state) || untested;
        // A load that does not turn may jump at any time.
        let contradicted = state.mismatch.is_contradicted()
            || self.has_turning_loads_only() && state.mismatch.is_rejected();
        let all = self.state(state);
        let at_one_speed = state.consistency.tolerance() == 0.0;
        let unconfirmed = self.has_turning_loads_only() && state.mismatch.is_unconfirmed();
        let of_sensors = unconfirmed.then(|| self.sum_of_squares(all));
        for (j, signal) in self.model.loads.iter().enumerate() {
            let d = 2 * NZ + j;
            let (Some(scale), Some(x)) = (self.model.scale.get(d), all.get(d)) else {
                continue;
            };
            let deviation = self.deviation(state, j);
            let deviation = if state.mismatch.on_trial() {
                deviation.max(state.trial_std[j % MAX_LOADS])
            } else {
                deviation
            };
            let one_speed = state.scheduled.one_speed_std[j % MAX_LOADS];
            let deviation = if at_one_speed && deviation < one_speed {
                one_speed
            } else {
                deviation
            };
            let error = beyond * state.scheduled.load_error[j % MAX_LOADS];
            let deviation = if error > 0.0 {
                libm::sqrtf(deviation * deviation + error * error)
            } else {
                deviation
            };
            let (value, std) = (x * scale, deviation * scale);
            let std = match of_sensors {
                Some(square) => libm::sqrtf(std * std + SENSORS_AT_FAULT * (square - std * std)),
                None => std,
            };
            let finite = value.is_finite() && std.is_finite();
            let fault = if !finite || std > signal.valid_std || !inside || unsettled {
                Fault::NotValid
            } else if contradicted {
                Fault::Contradicted
            } else {
                Fault::None
            };
            let _ = estimate.loads.push(LoadEstimate {
                value: if finite { value } else { 0.0 },
                std: if finite { std } else { f32::MAX },
                age: state.age.saturating_add(lag as u16),
                fault,
            });
        }
    }

    /// Sum of the squares of all loads (N^2): the variance of each where sensors are as wrong as the loads are large.
    #[cold]
    fn sum_of_squares(&self, all: &[f32; NX]) -> f32 {
        let forces = all.iter().zip(&self.model.scale).skip(2 * NZ);
        let squares = forces
            .take(self.model.loads.len())
            .map(|(x, scale)| x * scale * (x * scale));
        squares.sum()
    }

    /// Standard deviation of load `j` by the noise level in use, in the image's scale.
    pub(super) fn deviation(&self, state: &RotorState<NZ, NX>, j: usize) -> f32 {
        let table = state.scheduled.load_std[j % MAX_LOADS];
        let converged = state.clean_samples >= self.noise(state).full_samples && state.age == 0;
        if converged && state.smoothed_samples as usize >= self.lag() {
            return table;
        }
        let d = 2 * NZ + j;
        let own = &state.posterior.covariance[d % NX][d % NX];
        let lagged = self.lagged(state);
        let own = libm::sqrtf(lagged.map_or(*own, |moment| moment.variances[j % FORCES]));
        // By a gain, the variance stays that of another speed; and no recursion allows
        // for errors of the model.
        if own < table { table } else { own }
    }

    /// The sample that the estimate is of, where it lags.
    fn lagged<'s>(&self, state: &'s RotorState<NZ, NX>) -> Option<&'s LaggedState<NX>> {
        (self.lag() > 0).then(|| state.smoother.lagged(self.lag()))
    }

    /// The filter's state that the estimate is of, in the image's scale.
    pub fn state<'s>(&self, state: &'s RotorState<NZ, NX>) -> &'s [f32; NX] {
        (self.lagged(state)).map_or(&state.posterior.state, |moment| &moment.state)
    }

    /// The tracked speed that the estimate is of [rad/s].
    pub fn speed(&self, state: &RotorState<NZ, NX>) -> f32 {
        (self.lagged(state)).map_or(state.shaft.speed, |moment| moment.speed)
    }
}
