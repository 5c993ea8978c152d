//! The carrier angle: encoders, shifts of their counts, the pulse without encoder.

use nalgebra::RowSVector;

use super::{Encoder, Gearbox, GearboxState, PATIENCE, dot, judged};
use crate::estimate::SensorEstimate;
use crate::fault::Fault;
use crate::gaussian::Gaussian;
use crate::innovation::{Gate, Outcome};
use crate::kalman;
use crate::measurement::Measurement;
use crate::phase::{Phase, wrap_rad};
use crate::raw::{MAX_CHANNELS, MAX_ENCODERS};

/// Deviation of an encoder's readings within which they are as expected [standard deviations].
const WITHIN: f32 = 5.0;

/// Turn without a change of the count at which an encoder is stuck [standard deviations]: three
/// and a half counts, where the noise is that of the rounding.
const HELD: f32 = 12.0;

/// How an encoder's readings went on.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Track {
    angle: f32,
    /// Turn expected since its last change [rad].
    held: f32,
    /// Last two innovations [rad].
    past: [f32; 2],
    /// Samples in a row whose innovations went on evenly.
    even: u16,
    /// It went on evenly, and not as the model: the estimate has to start anew.
    pub(super) lost: bool,
}

impl Track {
    /// Whether the count stood still while the model turned by `turned` and went further than
    /// noise of `variance` explains.
    pub(super) fn stuck(&mut self, angle: f32, turned: f32, variance: f32) -> bool {
        if angle == self.angle {
            self.held += turned;
        } else {
            self.held = 0.0;
            self.angle = angle;
        }
        libm::fabsf(self.held) > HELD * libm::sqrtf(variance)
    }

    /// Takes in an innovation that was refused: counts that went on evenly have shifted,
    /// or, where they run away from the model, it is lost. Counts at random do neither.
    fn refuse(&mut self, innovation: f32, variance: f32) -> bool {
        let [last, before] = self.past;
        let step = wrap_rad(innovation - last);
        let bent = wrap_rad(step - wrap_rad(last - before));
        self.past = [innovation, last];
        // The second difference of three readings has six times their variance.
        if bent * bent > WITHIN * WITHIN * 6.0 * variance {
            self.even = 0;
        } else {
            self.even = self.even.saturating_add(1);
        }
        let patient = self.even < PATIENCE;
        if patient {
            return false;
        }
        self.even = 0;
        self.lost = step * step > WITHIN * WITHIN * 2.0 * variance;
        !self.lost
    }
}

impl<const NX: usize> Gearbox<'_, NX> {
    /// How far the carrier is ahead of the index's encoder by the estimate.
    pub(super) fn lead(&self, state: &GearboxState<NX>) -> Phase {
        let encoder = self
            .model
            .index
            .as_ref()
            .map_or(0, |index| usize::from(index.encoder));
        self.encoder_rows
            .get(encoder)
            .map_or(Phase::default(), |row| {
                Phase::from_rad(state.belief.state[0] - dot(row, &state.belief.state))
            })
    }

    pub(super) fn update_angle(
        &self,
        state: &mut GearboxState<NX>,
        k: usize,
        m: &Measurement,
    ) -> SensorEstimate {
        let (Some(encoder), Some(row)) = (self.model.encoders.get(k), self.encoder_rows.get(k))
        else {
            return SensorEstimate::default();
        };
        let angle = match m.angles.get(k) {
            Some(Ok(angle)) => angle.to_rad(),
            _ => {
                return SensorEstimate {
                    fault: Fault::Missing,
                    ..SensorEstimate::default()
                };
            }
        };
        let innovation = wrap_rad(angle - dot(row, &state.belief.state));
        let track = &mut state.tracks[k % MAX_ENCODERS];
        let stuck = track.stuck(angle, state.turned, encoder.variance);
        let mut shut = Gate::shut();
        let gate = if stuck {
            &mut shut
        } else {
            &mut state.gates[MAX_CHANNELS + k % MAX_ENCODERS]
        };
        let update = kalman::update(&mut state.belief, row, innovation, encoder.variance, gate);
        if update.outcome == Outcome::Gated && !stuck && track.refuse(innovation, encoder.variance)
        {
            shift(&mut state.belief, encoder, row, innovation);
        }
        let refused = if stuck { Fault::Stuck } else { Fault::Slipped };
        judged(angle, &update, 1.0, refused)
    }

    /// Without an encoder the pulse itself is the measurement of the angle; it
    /// came somewhere in the last sample period.
    pub(super) fn home_by_pulse(&self, state: &mut GearboxState<NX>) {
        let Some(index) = &self.model.index else {
            return;
        };
        let pulse = index.angle.to_rad();
        if state.homed_by_pulse {
            let mut row = RowSVector::<f32, NX>::zeros();
            row[0] = 1.0;
            let innovation = wrap_rad(pulse - state.belief.state[0]);
            let variance = index.tolerance_rad * index.tolerance_rad;
            kalman::update(
                &mut state.belief,
                &row,
                innovation,
                variance,
                &mut Gate::open(),
            );
        } else {
            state.belief.state[0] = pulse;
            state.homed_by_pulse = true;
        }
    }
}

/// Turns the carrier angle of a belief.
pub(super) fn turn<const NX: usize>(belief: &mut Gaussian<NX>, by: Phase) {
    belief.state[0] = wrap_rad(belief.state[0] + by.to_rad());
}

/// Takes an encoder's innovation as a shift of its counts.
///
/// No shaft jumps: an encoder that contradicts for as long as its gate is patient has
/// lost or gained counts. Its offset becomes as uncertain as the jump is large,
///
/// `P_oo + (nu / h_o)^2`,
///
/// and so takes the jump in the update that follows; of the twists, and with them
/// the loads, less than a hundredth of what the same innovation would do.
#[cold]
fn shift<const NX: usize>(
    belief: &mut Gaussian<NX>,
    encoder: &Encoder,
    row: &RowSVector<f32, NX>,
    innovation: f32,
) {
    let offset = usize::from(encoder.offset_state);
    let Some(per_unit) = row.get(offset) else {
        return;
    };
    let size = innovation / per_unit;
    belief.widen(offset, size * size);
    kalman::update(belief, row, innovation, encoder.variance, &mut Gate::open());
}
