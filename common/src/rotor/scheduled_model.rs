//! Interpolates the tables of a rotor's image at the present speed (`ScheduledModel`): increment
//! matrix, steady gains, innovation variances, standard deviations and model errors of the loads.

use serde::{Deserialize, Serialize};

use crate::io::estimate::MAX_LOADS;
use crate::io::raw::MAX_CHANNELS;
use crate::rotor::filter::FORCES;
use crate::rotor::fixed_lag_smoother::{Gain, MAX_LAG};
use crate::rotor::model::{NoiseModel, PackedF32, RotorModel};

/// Steps of the table by which the speed may move before the matrices follow.
const UPDATE_THRESHOLD: f32 = 1.0 / 128.0;

/// Entries of the tables, interpolated at one speed.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct ScheduledModel<const NZ: usize, const NX: usize> {
    place: f32,
    /// `D`.
    #[serde(with = "crate::matrix_serde")]
    pub increment_matrix: [[f32; NX]; NZ],
    /// Steady gains of the last sample, and of those before it.
    #[serde(with = "crate::matrix_serde")]
    pub gains: [Gain<NX>; 1 + MAX_LAG],
    /// Variance of each channel's innovation.
    pub variance: [f32; MAX_CHANNELS],
    /// Steady standard deviation of each load.
    pub load_std: [f32; MAX_LOADS],
    /// Steady standard deviation of each load where the speed has not changed: with the model error
    /// that white innovations do not show.
    pub one_speed_std: [f32; MAX_LOADS],
    /// Error of each load where the model errs by its usual tolerances.
    pub load_error: [f32; MAX_LOADS],
}

impl<const NZ: usize, const NX: usize> ScheduledModel<NZ, NX> {
    /// Of no speed yet.
    #[inline]
    pub fn new() -> Self {
        Self {
            place: f32::MAX,
            increment_matrix: [[0.0; NX]; NZ],
            gains: [[[0.0; NX]; MAX_CHANNELS]; 1 + MAX_LAG],
            variance: [0.0; MAX_CHANNELS],
            load_std: [0.0; MAX_LOADS],
            one_speed_std: [0.0; MAX_LOADS],
            load_error: [0.0; MAX_LOADS],
        }
    }

    /// The speed that the tables are at, in their steps from the lowest.
    pub fn place(&self) -> f32 {
        self.place
    }

    /// Follows the tables of another noise from now on.
    pub fn reset(&mut self, model: &RotorModel<'_>, noise: &NoiseModel<'_>, speed: f32) {
        self.place = f32::MAX;
        self.interpolate_at(model, noise, speed);
    }

    /// Interpolates the tables of `model` and `noise` at `speed` where it has moved enough.
    #[inline(never)]
    pub fn interpolate_at(&mut self, model: &RotorModel<'_>, noise: &NoiseModel<'_>, speed: f32) {
        let speeds = &model.speeds;
        let last = f32::from(speeds.count) - 1.0;
        let place = (speed - speeds.lowest) / speeds.step;
        if !place.is_finite() {
            return;
        }
        // `clamp` panics where the ends are the wrong way round.
        let place = match place {
            place if place > last => last,
            place if place > 0.0 => place,
            _ => 0.0,
        };
        if (place - self.place).abs() <= UPDATE_THRESHOLD {
            return;
        }
        self.place = place;
        let low = place as usize;
        let part = place - low as f32;
        let between = |tables, stride| TableCursor {
            tables,
            at: low * stride,
            next: if part > 0.0 { stride } else { 0 },
            part,
        };
        let mut increment_matrix = between(model.increment_matrix, model.dense_stride());
        for row in &mut self.increment_matrix {
            increment_matrix.read(row.get_mut(..2 * NZ + FORCES).unwrap_or_default());
        }
        let mut steady = between(noise.steady, model.steady_stride());
        let channels = model.channels.len();
        let mut row = [0.0; MAX_CHANNELS];
        for gain in self.gains.iter_mut().take(1 + usize::from(model.lag)) {
            for i in 0..NX {
                steady.read(row.get_mut(..channels).unwrap_or_default());
                for (column, value) in gain.iter_mut().zip(&row) {
                    column[i] = *value;
                }
            }
        }
        steady.read(self.variance.get_mut(..channels).unwrap_or_default());
        let tables = [
            &mut self.load_std,
            &mut self.one_speed_std,
            &mut self.load_error,
        ];
        for of_loads in tables {
            steady.read(of_loads.get_mut(..model.loads.len()).unwrap_or_default());
        }
    }
}

/// Numbers between those of two speeds of a table, one after the other.
struct TableCursor<'a> {
    /// The whole table.
    tables: PackedF32<'a>,
    /// Place of the next one at the lower speed.
    at: usize,
    /// From there to the one at the higher speed.
    next: usize,
    /// Part of the way to the higher speed, 0 to 1.
    part: f32,
}

impl TableCursor<'_> {
    /// Fills `into` with the next ones.
    // Inlined, each size of filter would hold several copies.
    #[inline(never)]
    fn read(&mut self, into: &mut [f32]) {
        for slot in into {
            let low = self.tables.get(self.at);
            *slot = low + self.part * (self.tables.get(self.at + self.next) - low);
            self.at += 1;
        }
    }
}
