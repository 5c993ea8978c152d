//! Estimates angle and speed of the wheel from its encoder angle at each sample by a second-order
//! phase-locked loop. The gains of the first readings are those of a least-squares line; an angle
//! error above 1 rad restarts the loop.

use serde::{Deserialize, Serialize};

use crate::io::fault::Fault;
use crate::io::measurement::Measurement;
use crate::signal::phase::Phase;

/// Natural frequency of the loop that tracks the wheel [rad/s]: it lags by 0.1 rad where a wheel is
/// braked at 90 rad/s^2.
const BANDWIDTH: f32 = 30.0;

/// Error of the angle beyond which the loop has lost the wheel [rad]: a locked loop lags by the
/// acceleration over the square of the bandwidth, which is 1 rad at 900 rad/s^2, ten times what a
/// wheel's brake does.
const LOST_LOCK: f32 = 1.0;

/// A wheel as a loop of second order follows it.
///
/// The gains start as those of a least-squares line through the readings since the start, and fall
/// until they reach those of the loop: the speed is found within some readings, whatever it was
/// before.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct WheelPll {
    /// Angle, once there was one.
    pub angle: Option<Phase>,
    /// Speed [rad/s].
    pub speed: f32,
    /// Readings since the loop started anew.
    readings: u16,
    /// Whether the gains are those of the loop.
    settled: bool,
    /// Whether the wheel was lost with the last reading.
    pub lost: bool,
}

impl WheelPll {
    /// Whether the speed is known as well as the loop can know it.
    pub fn is_settled(&self) -> bool {
        self.settled
    }

    /// Angle turned since the last sample [rad]; `dt_s`: between samples; `lost`: samples before
    /// this one.
    pub fn update(&mut self, m: &Measurement, dt_s: f32, lost: u16) -> f32 {
        self.lost = false;
        let elapsed = dt_s * (f32::from(lost) + 1.0);
        let turned = self.speed * elapsed;
        let read = m
            .angles
            .first()
            .copied()
            .unwrap_or(Err(Fault::Missing))
            .ok();
        let Some(angle) = self.angle else {
            self.angle = read;
            self.readings = u16::from(read.is_some());
            return 0.0;
        };
        let predicted = angle.wrapping_add(Phase::from_rad(turned));
        let Some(read) = read else {
            self.angle = Some(predicted);
            return turned;
        };
        let error = read.wrapping_sub(predicted).to_rad();
        let is_second = self.readings == 1 && lost == 0;
        if !is_second && (self.readings == 1 || error.abs() > LOST_LOCK) {
            *self = Self {
                angle: Some(read),
                speed: self.speed,
                readings: 1,
                settled: false,
                lost: true,
            };
            return turned + error;
        }
        let (by_angle, by_speed) = self.gains(elapsed);
        if is_second {
            // Two readings are the whole line: the speed before, which may be off by turns a
            // sample, has no part in it.
            let moved = read.wrapping_sub(angle).to_rad();
            self.speed = moved / elapsed;
            self.angle = Some(read);
            return moved;
        }
        let turned = turned + by_angle * error;
        self.speed += by_speed / elapsed * error;
        self.angle = Some(angle.wrapping_add(Phase::from_rad(turned)));
        turned
    }

    /// Gains of the next reading: of the angle, and of the speed times `elapsed` [s].
    ///
    /// Of a line through n readings `2 (2 n - 1) / (n (n + 1))` and `6 / (n (n + 1))`; of the loop
    /// `sqrt(2) w t` and `(w t)^2`. Over a gap longer than the loop remembers the speed is held and
    /// the angle is read anew.
    ///
    /// Source: Bar-Shalom, Li and Kirubarajan 2001, section 6.5; Brookner 1998, section 1.2.
    fn gains(&mut self, elapsed: f32) -> (f32, f32) {
        let part = BANDWIDTH * elapsed;
        let (loop_angle, loop_speed) = if part > 1.0 {
            (1.0, 0.0)
        } else {
            ((core::f32::consts::SQRT_2 * part).min(1.0), part * part)
        };
        if self.settled {
            return (loop_angle, loop_speed);
        }
        self.readings = self.readings.saturating_add(1);
        let n = f32::from(self.readings);
        let line = 1.0 / (n * (n + 1.0));
        self.settled = 6.0 * line <= part * part;
        (
            (2.0 * (2.0 * n - 1.0) * line).max(loop_angle),
            (6.0 * line).max(loop_speed),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::raw::{MAX_CHANNELS, MAX_ENCODERS};

    const DT_S: f32 = 5e-4;

    fn reading(angle: f64, lost: u32) -> Measurement {
        let turns = angle / core::f64::consts::TAU;
        let mut angles = [Err(Fault::Missing); MAX_ENCODERS];
        // 192 counts a turn.
        let counts = libm::floor(turns * 192.0);
        angles[0] = Ok(Phase((counts as i64 as u64).wrapping_mul(u64::MAX / 192)));
        Measurement {
            tick: 0,
            lost,
            stale: false,
            values: [Err(Fault::Missing); MAX_CHANNELS],
            angles,
            rehomed: None,
            homed: true,
            slipped: false,
        }
    }

    /// Samples until the speed is within 2 % of `speed` for good, of 2000.
    fn found_after(wheel: &mut WheelPll, speed: f64, mut angle: f64, lost: u16) -> usize {
        let mut last = 0;
        for k in 0..2000 {
            angle += speed * f64::from(DT_S);
            let lost = if k == 0 { lost } else { 0 };
            wheel.update(&reading(angle, lost.into()), DT_S, lost);
            if (f64::from(wheel.speed) - speed).abs() > 0.02 * speed {
                last = k + 1;
            }
        }
        last
    }

    #[test]
    fn the_speed_is_found_from_rest_after_jumps_of_the_tick_and_from_any_wrong_speed() {
        let mut wheel = WheelPll::default();
        let found = found_after(&mut wheel, 105.0, 0.0, 0);
        assert!(found < 100, "{found}");
        let turned = 105.0 * 2000.0 * f64::from(DT_S);
        // The tick says that 1000 samples were lost; the angle goes on as if none were.
        let found = found_after(&mut wheel, 105.0, turned, 1000);
        assert!(found < 200, "{found}");
        for wrong in [-1e4, -300.0, 0.0, 1400.0, 9000.0, 4.0e5] {
            wheel.speed = wrong;
            let found = found_after(&mut wheel, 60.0, 1.0, 0);
            assert!(found < 400, "{wrong}: {found}");
        }
    }

    #[test]
    fn a_real_gap_leaves_the_speed_as_it_was() {
        let mut wheel = WheelPll::default();
        found_after(&mut wheel, 105.0, 0.0, 0);
        let turned = 105.0 * 2000.0 * f64::from(DT_S) + 105.0 * 1000.0 * f64::from(DT_S);
        assert_eq!(found_after(&mut wheel, 105.0, turned, 1000), 0);
    }
}
