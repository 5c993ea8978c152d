//! Angle, speed and acceleration of the shaft, tracked from its encoder.

use super::model::ShaftEncoder;
use crate::phase::Phase;

/// Slowest speed at which a force in proportion to the speed squared is
/// scaled from sample to sample [rad/s].
const SLOWEST: f32 = 1.0;

/// The tracked shaft.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shaft {
    angle: Phase,
    /// Speed [rad/s].
    pub speed: f32,
    /// [rad/s^2]
    acceleration: f32,
    readings: u8,
}

/// What the shaft did in one sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Angle that it turned by [rad].
    pub turned: f32,
    /// Mean speed meanwhile [rad/s].
    pub speed: f32,
    /// Speed squared over that of the sample before.
    pub growth: f32,
}

impl Shaft {
    /// A shaft of which only a speed is known.
    pub fn new(speed: f32) -> Self {
        Self {
            angle: Phase::default(),
            speed,
            acceleration: 0.0,
            readings: 0,
        }
    }

    /// The tracked angle.
    pub fn angle(&self) -> Phase {
        self.angle
    }

    /// The angle was turned by the index pulse.
    pub fn turn(&mut self, by: Phase) {
        self.angle = self.angle.turned_by(by);
    }

    /// `samples` samples of `dt` [s] on: with the acceleration as it is, then towards
    /// `reading` by the encoder's gains.
    ///
    /// `err = reading - angle`, `angle += a err`, `speed += b err`, `acceleration += c err`: a
    /// run-up at a constant acceleration is followed without lag. The first two readings set
    /// angle and speed; where one is missing, the speed is held.
    ///
    /// Source: Kalata, The tracking index, IEEE Trans. Aerosp. Electron. Syst. 20 (1984).
    pub fn advance(
        &mut self,
        dt: f32,
        samples: u32,
        reading: Option<Phase>,
        encoder: Option<&ShaftEncoder>,
    ) -> Motion {
        let before = self.speed;
        let span = dt * samples as f32;
        let gained = self.acceleration * span;
        let mut turned = (before + 0.5 * gained) * span;
        self.speed += gained;
        if let (Some(reading), Some(encoder)) = (reading, encoder) {
            let error = match self.readings {
                0 => 0.0,
                _ => reading
                    .since(self.angle.turned_by(Phase::from_rad(turned)))
                    .to_rad(),
            };
            match self.readings {
                0 => self.angle = reading,
                1 => {
                    turned += error;
                    self.speed = turned / span;
                }
                _ => {
                    turned += encoder.angle_gain * error;
                    self.speed += encoder.speed_gain * error;
                    self.acceleration += encoder.acceleration_gain * error;
                }
            }
            let first = self.readings == 0;
            self.readings = self.readings.saturating_add(1).min(2);
            if first {
                return Motion {
                    turned,
                    speed: self.speed,
                    growth: 1.0,
                };
            }
        } else {
            self.acceleration = 0.0;
        }
        self.angle = self.angle.turned_by(Phase::from_rad(turned));
        let slow = self.speed.abs() < SLOWEST || before.abs() < SLOWEST || self.readings == 1;
        let ratio = if slow { 1.0 } else { self.speed / before };
        Motion {
            turned,
            speed: 0.5 * (before + self.speed),
            growth: ratio * ratio,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measurement::Counter;
    use crate::phase::PhaseStep;

    const DT: f32 = 1e-3;

    /// Poles at 10 Hz.
    fn encoder() -> ShaftEncoder {
        let gone = 1.0 - libm::expf(-core::f32::consts::TAU * 10.0 * DT);
        let rest = 1.0 - gone;
        ShaftEncoder {
            counter: Counter {
                step: PhaseStep(1 << 52),
                bits: 16,
            },
            angle_gain: 1.0 - rest * rest * rest,
            speed_gain: 1.5 * gone * gone * (1.0 + rest) / DT,
            acceleration_gain: gone * gone * gone / (DT * DT),
        }
    }

    /// The shaft after each of `samples` of a run-up from 50 rad/s at 40 rad/s^2, and the true speed.
    fn run_up(shaft: &mut Shaft, samples: u32) -> f32 {
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
        let mut shaft = Shaft::new(0.0);
        let speed = run_up(&mut shaft, 2000);
        assert!((shaft.speed - speed).abs() < 0.01, "{shaft:?}, {speed}");
        assert!((shaft.acceleration - 40.0).abs() < 1.0, "{shaft:?}");
    }

    #[test]
    fn without_readings_the_speed_is_held() {
        let mut shaft = Shaft::new(0.0);
        run_up(&mut shaft, 2000);
        shaft.advance(DT, 1, None, Some(&encoder()));
        let held = shaft.speed;
        for _ in 0..1000 {
            shaft.advance(DT, 1, None, Some(&encoder()));
        }
        assert_eq!(shaft.speed, held);
    }
}
