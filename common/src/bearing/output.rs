//! What is said after a sample.

use super::joint::{LOAD, Told};
use super::{Bearing, BearingState, LOADS, ROWS};
use crate::estimate::{Estimate, LoadEstimate, SensorEstimate};
use crate::fault::Fault;
use crate::measurement::Measurement;
use crate::phase::{Phase, wrap_rad};

/// A load of which nothing is known.
pub(super) const UNKNOWN: LoadEstimate = LoadEstimate {
    value: 0.0,
    std: f32::MAX,
    age: u16::MAX,
    fault: Fault::NotValid,
};

/// SI size of the strains' unit.
const STRAIN: f32 = 1e-6;

impl Bearing {
    /// Makes the champion's loads those that are said, where they can be believed.
    pub(super) fn publish(&self, state: &mut BearingState) {
        state.age = 0;
        let contradicted = state.consistency.is_contradicted();
        let locked = state.is_locked() && !contradicted;
        let radius = self.model.geometry.radius_mm;
        let slipped = (0..ROWS).any(|row| {
            state.champion.gaussian.state[ROWS + row].abs() > self.model.tuning.slip_limit
        });
        for i in 0..LOADS {
            // kN; moments over the radius [mm] in kN: N m.
            let unit = if i < 3 { 1000.0 } else { radius };
            let value = state.champion.gaussian.state[LOAD + i] * unit;
            let variance = state.champion.gaussian.upper[LOAD + i][LOAD + i];
            let std = libm::sqrtf(variance.max(0.0)) * unit;
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
                    ..UNKNOWN
                }
            } else {
                UNKNOWN
            };
        }
    }
}

/// What is said after a sample.
pub(super) fn estimate(state: &BearingState, m: &Measurement) -> Estimate {
    let mut estimate = Estimate {
        tick: m.tick,
        lost: m.lost,
        angle_rad: wrap_rad(state.wheel.angle.map_or(0.0, Phase::to_rad)),
        homed: true,
        ..Estimate::default()
    };
    for load in &state.published {
        let _ = estimate.loads.push(LoadEstimate {
            age: state.age,
            ..*load
        });
    }
    for (g, told) in state.told.iter().enumerate() {
        let reading = m.values.get(g).copied().unwrap_or(Err(Fault::Missing));
        let known = if state.running {
            *told
        } else {
            Told::default()
        };
        let _ = estimate.sensors.push(SensorEstimate {
            measured: reading.unwrap_or(0.0) * STRAIN,
            innovation: known.mean.0 * STRAIN,
            innovation_variance: known.mean.1 * (STRAIN * STRAIN),
            nis: known.nis,
            fault: reading.err().unwrap_or(state.health.fault(g)),
        });
    }
    let angle = m.angles.first().copied().unwrap_or(Err(Fault::Missing));
    let _ = estimate.sensors.push(SensorEstimate {
        measured: angle.map_or(0.0, Phase::to_rad),
        fault: angle.err().unwrap_or(Fault::None),
        ..SensorEstimate::default()
    });
    estimate
}
