//! Reports the loads of the primary hypothesis in N and N m with standard deviations, or why they
//! are not valid, after each block, and builds the `Estimate` of each sample from them and the
//! innovations of the gauges.

use crate::bearing::ekf::{BlockInnovation, LOAD_INDEX};
use crate::bearing::{BearingEstimator, BearingState, LOADS, ROWS};
use crate::io::estimate::{Estimate, LoadEstimate, SensorEstimate};
use crate::io::fault::Fault;
use crate::io::measurement::Measurement;
use crate::signal::phase::{Phase, wrap_rad};

/// A load that is not valid.
pub(crate) const NO_ESTIMATE: LoadEstimate = LoadEstimate {
    value: 0.0,
    std: f32::MAX,
    age: u16::MAX,
    fault: Fault::NotValid,
};

/// Factor on the standard deviation while a gauge is left out: errors of the model that four gauges
/// average out. Without it 1.13 instead of 0.73 % of the samples of later faults were misleading.
const WIDENED: f32 = 1.5;

/// SI size of the strains' unit.
const STRAIN: f32 = 1e-6;

impl BearingEstimator {
    /// Reports the loads of the primary hypothesis where it is accepted.
    pub(crate) fn publish(&self, state: &mut BearingState) {
        state.age = 0;
        let contradicted = state.consistency.is_contradicted() || state.lacks_gauges();
        let locked = state.is_locked() && !contradicted;
        let widened = if state.holds_slow_states() {
            WIDENED
        } else {
            1.0
        };
        let radius = self.model.geometry.radius_mm;
        let slipped = (0..ROWS).any(|row| {
            state.primary.gaussian.state[ROWS + row].abs() > self.model.tuning.slip_limit
        });
        for i in 0..LOADS {
            // kN; moments over the radius [mm] in kN: N m.
            let unit = if i < 3 { 1000.0 } else { radius };
            let value = state.primary.gaussian.state[LOAD_INDEX + i] * unit;
            let variance = state.primary.gaussian.upper[LOAD_INDEX + i][LOAD_INDEX + i];
            let std = libm::sqrtf(variance.max(0.0)) * unit * widened;
            let limit = self.model.loads.get(i).map_or(0.0, |load| load.valid_std);
            state.published[i] = if locked && value.is_finite() && std <= limit {
                LoadEstimate {
                    value,
                    std,
                    age: 0,
                    fault: if slipped { Fault::Slipped } else { Fault::None },
                }
            } else if contradicted {
                LoadEstimate {
                    fault: Fault::Contradicted,
                    ..NO_ESTIMATE
                }
            } else {
                NO_ESTIMATE
            };
        }
    }
}

/// Fills in the estimate of a sample.
pub(crate) fn fill(estimate: &mut Estimate, state: &BearingState, m: &Measurement) {
    estimate.begin(m.tick, m.lost);
    estimate.angle_rad = wrap_rad(state.wheel.angle.map_or(0.0, Phase::to_rad));
    estimate.homed = true;
    for load in &state.published {
        let _ = estimate.loads.push(LoadEstimate {
            age: state.age,
            ..*load
        });
    }
    for (g, innovations) in state.innovations.iter().enumerate() {
        let reading = m.values.get(g).copied().unwrap_or(Err(Fault::Missing));
        let known = if state.running {
            *innovations
        } else {
            BlockInnovation::default()
        };
        let _ = estimate.sensors.push(SensorEstimate {
            measured: reading.unwrap_or(0.0) * STRAIN,
            innovation: known.mean.0 * STRAIN,
            innovation_variance: known.mean.1 * (STRAIN * STRAIN),
            nis: known.nis,
            fault: reading.err().unwrap_or(state.fault(g)),
        });
    }
    let angle = m.angles.first().copied().unwrap_or(Err(Fault::Missing));
    let _ = estimate.sensors.push(SensorEstimate {
        measured: angle.map_or(0.0, Phase::to_rad),
        fault: angle.err().unwrap_or(state.encoder.fault()),
        ..SensorEstimate::default()
    });
}
