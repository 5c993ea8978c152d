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
use crate::io::measurement::{Measured, Measurement};
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

/// Readings of an encoder that were used, from which on the model's angle is sound: ten times those
/// that show that its counts have shifted.
const SOUND: u16 = 10 * PATIENCE;

/// Readings before its counts went on evenly for [`PATIENCE`] that a single jump explains: those of
/// the second difference. After more, the model has gone on alone for too long.
const JUMP: u16 = 3;

/// Recent readings of an encoder, to detect stuck and shifted counts.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Track {
    angle: f32,
    /// Turn expected since its last change [rad].
    held: f32,
    /// Whether that was too far, since its last change.
    stuck: bool,
    /// Last two innovations [rad].
    past: [f32; 2],
    /// Samples in a row whose innovations went on evenly.
    even: u16,
    /// Readings that were used since the start, or since more were refused than a jump explains.
    used: u16,
    /// It went on evenly, and not as the model: the estimate has to start anew.
    pub(crate) lost: bool,
}

impl Track {
    /// Whether the count has stood still since the model, which turns by `turned` in this sample,
    /// went further than noise of `variance` explains.
    pub(crate) fn stuck(&mut self, angle: f32, turned: f32, variance: f32) -> bool {
        if angle == self.angle {
            self.held += turned;
        } else {
            self.held = 0.0;
            self.angle = angle;
            self.stuck = false;
        }
        self.stuck |= self.held * self.held > HELD * HELD * variance;
        self.stuck
    }

    /// As it is after a new start of the estimate: a stuck encoder stays so until it moves.
    pub(crate) fn restarted(self) -> Self {
        Self {
            angle: self.angle,
            stuck: self.stuck,
            ..Self::default()
        }
    }

    pub(crate) fn is_stuck(self) -> bool {
        self.stuck
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
            other => {
                state.tracks[k % MAX_ENCODERS].used = 0;
                return SensorEstimate {
                    fault: reason(other),
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
        if update.used() {
            track.used = track.used.saturating_add(1);
        } else if stuck || gate.rejections() > PATIENCE + JUMP {
            track.used = 0;
        }
        if update.outcome == Outcome::Gated && !stuck && track.refuse(innovation, encoder.variance)
        {
            if track.used >= SOUND && encoder.offset_state == 0 {
                // No shaft jumps: the counts did.
                state.unwrap.shift(k, Phase::from_rad(-innovation));
            } else {
                absorb_count_shift(&mut state.posterior, encoder, row, innovation);
            }
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

/// Why an encoder gives no angle.
pub(crate) fn reason(angle: Option<&Measured<Phase>>) -> Fault {
    angle
        .and_then(|angle| angle.err())
        .unwrap_or(Fault::Missing)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stuck_encoder_stays_so_until_it_moves() {
        let mut track = Track::default();
        // By hand: 12 deviations of 0.01 rad are 0.12 rad.
        assert!(!(0..12).any(|_| track.stuck(1.0, 0.01, 1e-4)));
        assert!(track.stuck(1.0, 0.02, 1e-4));
        // The model turns back; and it starts anew.
        assert!((0..20).all(|_| track.stuck(1.0, -0.01, 1e-4)));
        track = track.restarted();
        assert!(track.is_stuck() && track.stuck(1.0, 0.0, 1e-4));
        assert!(!track.stuck(1.001, 0.01, 1e-4));
    }
}
