//! Tracks angle, speed and acceleration of a rotor's shaft from its encoder angle at each sample by
//! a filter with fixed gains (`ShaftTracker`); without an encoder the speed is constant. Also
//! computes the change of a rotating force from one sample to the next.

use serde::{Deserialize, Serialize};

use crate::rotor::model::ShaftEncoder;
use crate::signal::phase::Phase;

/// Slowest speed at which a force in proportion to the speed squared is
/// scaled from sample to sample [rad/s].
const SLOWEST: f32 = 1.0;

/// In place of the number of readings: enough for the encoder's own gains.
const SETTLED: u16 = u16::MAX;

/// The tracked shaft.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShaftTracker {
    angle: Phase,
    /// Speed [rad/s].
    pub speed: f32,
    /// Acceleration (rad/s^2).
    acceleration: f32,
    /// Readings since the start, or [`SETTLED`].
    readings: u16,
}

/// Motion of the shaft in one sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShaftIncrement {
    /// Angle that it turned by [rad].
    pub turned: f32,
    /// Mean speed meanwhile [rad/s].
    pub speed: f32,
    /// Speed squared over that of the sample before.
    pub speed_squared_ratio: f32,
}

impl ShaftTracker {
    /// A shaft of which only a speed is known.
    pub fn new(speed: f32) -> Self {
        Self {
            angle: Phase::default(),
            speed,
            acceleration: 0.0,
            readings: 0,
        }
    }

    /// Whether so many readings are there as the encoder's gains look back on.
    pub fn is_settled(&self) -> bool {
        self.readings == SETTLED
    }

    /// The tracked angle.
    pub fn angle(&self) -> Phase {
        self.angle
    }

    /// Turns the angle, as homing by the index pulse does.
    pub fn rotate(&mut self, by: Phase) {
        self.angle = self.angle.wrapping_add(by);
    }

    /// `samples` samples of `dt` [s] on: with the acceleration as it is, then towards
    /// `reading` by the encoder's gains.
    ///
    /// `err = reading - angle`, `angle += a err`, `speed += b err`, `acceleration += c err`: a
    /// run-up at a constant acceleration is followed without lag. Where a reading is missing, the
    /// speed is held.
    ///
    /// The first reading sets the angle; until as many are there as the encoder's gains look
    /// back on, the line through all of them is followed, of `n` before this one:
    /// `a = (4 n + 2) / ((n + 1) (n + 2))`, `b = 6 / ((n + 1) (n + 2) dt)`, `c = 0`.
    ///
    /// Source: Kalata, The tracking index, IEEE Trans. Aerosp. Electron. Syst. 20 (1984);
    /// Brookner, Tracking and Kalman Filtering Made Easy (1998), section 1.2.10, growing memory.
    pub fn advance(
        &mut self,
        dt: f32,
        samples: u32,
        reading: Option<Phase>,
        encoder: Option<&ShaftEncoder>,
    ) -> ShaftIncrement {
        let before = self.speed;
        let span = dt * samples as f32;
        let gained = self.acceleration * span;
        let mut turned = (before + 0.5 * gained) * span;
        self.speed += gained;
        let settled = self.readings == SETTLED;
        match (reading, encoder) {
            (Some(reading), Some(_)) if self.readings == 0 => {
                self.angle = reading;
                self.readings = 1;
                return ShaftIncrement {
                    turned,
                    speed: self.speed,
                    speed_squared_ratio: 1.0,
                };
            }
            (Some(reading), Some(encoder)) => {
                let error = reading
                    .wrapping_sub(self.angle.wrapping_add(Phase::from_rad(turned)))
                    .to_rad();
                let [angle_gain, speed_gain, acceleration_gain] = self.gains(span, encoder);
                turned += angle_gain * error;
                self.speed += speed_gain * error;
                self.acceleration += acceleration_gain * error;
            }
            _ => self.acceleration = 0.0,
        }
        self.angle = self.angle.wrapping_add(Phase::from_rad(turned));
        // Before, its speed is found, and does not change.
        let held = !settled || self.speed.abs() < SLOWEST || before.abs() < SLOWEST;
        let ratio = if held { 1.0 } else { self.speed / before };
        ShaftIncrement {
            turned,
            speed: 0.5 * (before + self.speed),
            speed_squared_ratio: ratio * ratio,
        }
    }

    /// `[a, b, c]` for a reading `span` [s] after the last one.
    fn gains(&mut self, span: f32, encoder: &ShaftEncoder) -> [f32; 3] {
        if self.readings != SETTLED {
            let n = f32::from(self.readings);
            let spread = (n + 1.0) * (n + 2.0);
            let growing = [(4.0 * n + 2.0) / spread, 6.0 / (spread * span), 0.0];
            if growing[0] > encoder.angle_gain {
                self.readings = self.readings.saturating_add(1);
                return growing;
            }
            self.readings = SETTLED;
        }
        [
            encoder.angle_gain,
            encoder.speed_gain,
            encoder.acceleration_gain,
        ]
    }
}

/// What a force that turns by `angle` [rad] and grows `speed_squared_ratio` times gains along
/// itself and across: `(g cos(a) - 1, g sin(a))`, by half the angle, so that nothing is lost beside
/// the 1.
pub fn rotation_increment(angle: f32, speed_squared_ratio: f32) -> (f32, f32) {
    let half = 0.5 * angle;
    let (sine, cosine) = (libm::sinf(half), libm::cosf(half));
    let gained = speed_squared_ratio - 1.0;
    (
        gained - speed_squared_ratio * (2.0 * sine * sine),
        speed_squared_ratio * (2.0 * sine * cosine),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::measurement::EncoderScaling;
    use crate::signal::phase::PhaseStep;

    const DT: f32 = 1e-3;

    /// Poles at 10 Hz.
    fn encoder() -> ShaftEncoder {
        let gone = 1.0 - libm::expf(-core::f32::consts::TAU * 10.0 * DT);
        let rest = 1.0 - gone;
        ShaftEncoder {
            counter: EncoderScaling {
                step: PhaseStep(1 << 52),
                bits: 16,
            },
            angle_gain: 1.0 - rest * rest * rest,
            speed_gain: 1.5 * gone * gone * (1.0 + rest) / DT,
            acceleration_gain: gone * gone * gone / (DT * DT),
        }
    }

    /// The shaft after each of `samples` of a run-up from 50 rad/s at 40 rad/s^2, and the true
    /// speed.
    fn run_up(shaft: &mut ShaftTracker, samples: u32) -> f32 {
        let mut speed = 50.0;
        for k in 0..samples {
            let t = f64::from(k) * f64::from(DT);
            let angle = (50.0 * t + 20.0 * t * t) % core::f64::consts::TAU;
            speed = (50.0 + 40.0 * t) as f32;
            let reading = Phase::from_rad(angle as f32);
            shaft.advance(DT, 1, Some(reading), Some(&encoder()));
        }
        speed
    }

    #[test]
    fn a_run_up_is_followed_without_lag() {
        let mut shaft = ShaftTracker::new(0.0);
        let speed = run_up(&mut shaft, 2000);
        assert!((shaft.speed - speed).abs() < 0.01, "{shaft:?}, {speed}");
        assert!((shaft.acceleration - 40.0).abs() < 1.0, "{shaft:?}");
    }

    /// Of 60 counts a turn, at 37 rad/s: a sample moves on by none or by one.
    #[test]
    fn few_counts_a_turn_tell_the_speed_from_many_readings() {
        let mut shaft = ShaftTracker::new(80.0);
        for k in 0..200 {
            let turns = f64::from(k) * f64::from(DT) * 37.0 / core::f64::consts::TAU;
            let counts = libm::floor(60.0 * turns) % 60.0;
            let angle = (counts / 60.0 * core::f64::consts::TAU) as f32;
            shaft.advance(DT, 1, Some(Phase::from_rad(angle)), Some(&encoder()));
            if k >= 20 {
                assert!((shaft.speed - 37.0).abs() < 5.0, "{k}: {shaft:?}");
            }
        }
    }

    #[test]
    fn without_readings_the_speed_is_held() {
        let mut shaft = ShaftTracker::new(0.0);
        run_up(&mut shaft, 2000);
        shaft.advance(DT, 1, None, Some(&encoder()));
        let held = shaft.speed;
        for _ in 0..1000 {
            shaft.advance(DT, 1, None, Some(&encoder()));
        }
        assert_eq!(shaft.speed, held);
    }
}
