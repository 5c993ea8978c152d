//! The wheel's angle between the steps of its encoder.

use crate::fault::Fault;
use crate::measurement::Measurement;
use crate::phase::Phase;

/// Natural frequency of the loop that follows the wheel [rad/s].
const BANDWIDTH: f32 = 30.0;

/// A wheel as a loop of second order follows it.
#[derive(Clone, Copy, Debug, Default)]
pub struct Wheel {
    /// Angle, once there was one.
    pub angle: Option<Phase>,
    /// Speed [rad/s].
    pub speed: f32,
}

impl Wheel {
    /// Angle turned since the last sample [rad]; `dt_s`: between samples.
    pub fn follow(&mut self, m: &Measurement, dt_s: f32) -> f32 {
        let elapsed = dt_s * (m.lost.min(1000) + 1) as f32;
        let mut turned = self.speed * elapsed;
        let read = m
            .angles
            .first()
            .copied()
            .unwrap_or(Err(Fault::Missing))
            .ok();
        match (self.angle, read) {
            (Some(angle), Some(read)) => {
                let error = read
                    .since(angle.turned_by(Phase::from_rad(turned)))
                    .to_rad();
                let by_angle = (core::f32::consts::SQRT_2 * BANDWIDTH * elapsed).min(1.0);
                turned += by_angle * error;
                self.speed += BANDWIDTH * BANDWIDTH * elapsed * error;
                self.angle = Some(angle.turned_by(Phase::from_rad(turned)));
            }
            (Some(angle), None) => self.angle = Some(angle.turned_by(Phase::from_rad(turned))),
            (None, read) => {
                self.angle = read;
                turned = 0.0;
            }
        }
        turned
    }
}
