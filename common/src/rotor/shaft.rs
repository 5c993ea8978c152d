//! Angle and speed of the shaft, tracked from its encoder.

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
    readings: u8,
}

/// What the shaft did in one sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Angle that it turned by [rad].
    pub turned: f32,
    /// Speed squared over that of the sample before.
    pub growth: f32,
}

impl Shaft {
    /// A shaft of which only a speed is known.
    pub fn new(speed: f32) -> Self {
        Self {
            angle: Phase::default(),
            speed,
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

    /// `samples` samples of `dt` [s] on: at the speed as it is, then towards
    /// `reading` by the encoder's gains.
    ///
    /// `err = reading - angle`, `angle += a err`, `speed += b err`. The first two
    /// readings set angle and speed.
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
        let mut turned = self.speed * span;
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
                }
            }
            let first = self.readings == 0;
            self.readings = self.readings.saturating_add(1).min(2);
            if first {
                return Motion {
                    turned,
                    growth: 1.0,
                };
            }
        }
        self.angle = self.angle.turned_by(Phase::from_rad(turned));
        let slow = self.speed.abs() < SLOWEST || before.abs() < SLOWEST || self.readings == 1;
        let ratio = if slow { 1.0 } else { self.speed / before };
        Motion {
            turned,
            growth: ratio * ratio,
        }
    }
}
