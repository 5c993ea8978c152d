//! Updates the carrier angle of the drivetrain filter with the angle of each encoder, detects stuck
//! encoders and shifted counts, and absorbs a shift in the encoder's offset. Without an encoder the
//! index pulse sets the angle.

use nalgebra::RowSVector;
use serde::{Deserialize, Serialize};

use crate::drivetrain::{
    DrivetrainEstimator, DrivetrainState, Encoder, PATIENCE, dot, to_sensor_estimate,
};
use crate::io::estimate::SensorEstimate;
use crate::io::fault::Fault;
use crate::io::measurement::Measurement;
use crate::io::raw::{MAX_CHANNELS, MAX_ENCODERS};
use crate::kalman;
use crate::kalman::gaussian::Gaussian;
use crate::kalman::innovation::{Gate, Outcome};
use crate::signal::phase::{Phase, wrap_rad};

/// Deviation of an encoder's readings within which they are as expected [standard deviations].
const WITHIN: f32 = 5.0;

/// Turn without a change of the count at which an encoder is stuck [standard deviations]: three
/// and a half counts, where the noise is that of the rounding.
const HELD: f32 = 12.0;

/// Recent readings of an encoder, to detect stuck and shifted counts.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Track {
    angle: f32,
    /// Turn expected since its last change [rad].
    held: f32,
    /// Last two innovations [rad].
    past: [f32; 2],
    /// Samples in a row whose innovations went on evenly.
    even: u16,
    /// It went on evenly, and not as the model: the estimate has to start anew.
    pub(crate) lost: bool,
}

impl Track {
    /// Whether the count stood still while the model turned by `turned` and went further than
    /// noise of `variance` explains.
    pub(crate) fn stuck(&mut self, angle: f32, turned: f32, variance: f32) -> bool {
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
        let output = wrap_rad(step - wrap_rad(last - before));
        self.past = [innovation, last];
        // The second difference of three readings has six times their variance.
        if output * output > WITHIN * WITHIN * 6.0 * variance {
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

impl<const NX: usize> DrivetrainEstimator<'_, NX> {
    /// Angle by which the carrier is ahead of the index's encoder, by the estimated twists.
    pub(crate) fn index_encoder_offset(&self, state: &DrivetrainState<NX>) -> Phase {
        let encoder = self
            .model
            .index
            .as_ref()
            .map_or(0, |index| usize::from(index.encoder));
        self.encoder_rows
            .get(encoder)
            .map_or(Phase::default(), |row| {
                Phase::from_rad(state.posterior.state[0] - dot(row, &state.posterior.state))
            })
    }

    pub(crate) fn update_angle(
        &self,
        state: &mut DrivetrainState<NX>,
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
        let innovation = wrap_rad(angle - dot(row, &state.posterior.state));
        let track = &mut state.tracks[k % MAX_ENCODERS];
        let stuck = track.stuck(angle, state.turned, encoder.variance);
        let mut shut = Gate::closed();
        let gate = if stuck {
            &mut shut
        } else {
            &mut state.gates[MAX_CHANNELS + k % MAX_ENCODERS]
        };
        let update = kalman::update(
            &mut state.posterior,
            row,
            innovation,
            encoder.variance,
            gate,
        );
        if update.outcome == Outcome::Gated && !stuck && track.refuse(innovation, encoder.variance)
        {
            absorb_count_shift(&mut state.posterior, encoder, row, innovation);
        }
        let refused = if stuck { Fault::Stuck } else { Fault::Slipped };
        to_sensor_estimate(angle, &update, 1.0, refused)
    }

    /// Without an encoder the pulse itself is the measurement of the angle; it
    /// came somewhere in the last sample period.
    pub(crate) fn home_by_pulse(&self, state: &mut DrivetrainState<NX>) {
        let Some(index) = &self.model.index else {
            return;
        };
        let pulse = index.angle.to_rad();
        if state.homed_by_pulse {
            let mut row = RowSVector::<f32, NX>::zeros();
            row[0] = 1.0;
            let innovation = wrap_rad(pulse - state.posterior.state[0]);
            let variance = index.tolerance_rad * index.tolerance_rad;
            kalman::update(
                &mut state.posterior,
                &row,
                innovation,
                variance,
                &mut Gate::open(),
            );
        } else {
            state.posterior.state[0] = pulse;
            state.homed_by_pulse = true;
        }
    }
}

/// Turns the carrier angle of a posterior.
pub(crate) fn rotate<const NX: usize>(posterior: &mut Gaussian<NX>, by: Phase) {
    posterior.state[0] = wrap_rad(posterior.state[0] + by.to_rad());
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
fn absorb_count_shift<const NX: usize>(
    posterior: &mut Gaussian<NX>,
    encoder: &Encoder,
    row: &RowSVector<f32, NX>,
    innovation: f32,
) {
    let offset = usize::from(encoder.offset_state);
    let Some(per_unit) = row.get(offset) else {
        return;
    };
    let size = innovation / per_unit;
    posterior.widen(offset, size * size);
    kalman::update(
        posterior,
        row,
        innovation,
        encoder.variance,
        &mut Gate::open(),
    );
}
