//! Computes the time of raw samples (s since the epoch) from their ticks, also across restarts of
//! the recorder. Decides for each sample whether ticks are missing before it, it is repeated, or
//! the machine started anew (`Step`).

use serde::{Deserialize, Serialize};

/// Largest distance between the time by ticks and the clock of this host (s): at 50 ppm it is
/// reached after two weeks. Beyond it the machine has started anew, or its time is set anew.
const TOLERANCE_S: f64 = 60.0;

/// Distance of a repeated sample from its first one (s).
const REPEATED_S: f64 = 0.5;

/// Time of tick 0 and the last tick.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SampleClock {
    /// Time of tick 0 (s) since the epoch.
    pub zero_s: f64,
    /// Tick of the last sample, counted on where the tick on the bus wraps.
    pub tick: u64,
}

/// What a tick is after the one before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Later; so many ticks are missing in between.
    Later(u64),
    /// A sample that was there before.
    Repeated,
    /// The machine has started anew, or its clock is set anew.
    Anew,
}

impl SampleClock {
    /// From a first sample with `tick` at the time `now_s`.
    pub fn new(tick: u32, now_s: f64, rate_hz: f64) -> Self {
        Self {
            zero_s: now_s - f64::from(tick) / rate_hz,
            tick: u64::from(tick),
        }
    }

    /// Time of the last sample (s).
    pub fn t(&self, rate_hz: f64) -> f64 {
        self.time_of(self.tick, rate_hz)
    }

    /// Time of `tick` (s).
    pub fn time_of(&self, tick: u64, rate_hz: f64) -> f64 {
        self.zero_s + tick as f64 / rate_hz
    }

    /// Goes on to the sample with `tick` that came at `now_s`.
    pub fn follow(&mut self, tick: u32, now_s: f64, rate_hz: f64) -> Step {
        let step = tick.wrapping_sub(self.tick as u32) as i32;
        let next = self.tick.saturating_add_signed(i64::from(step));
        let apart_s = (self.time_of(next, rate_hz) - now_s).abs();
        if step > 0 && apart_s <= TOLERANCE_S {
            self.tick = next;
            return Step::Later(step as u64 - 1);
        }
        if step <= 0 && apart_s <= REPEATED_S {
            return Step::Repeated;
        }
        *self = Self::new(tick, now_s, rate_hz);
        Step::Anew
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_go_on_wrap_repeat_and_begin_anew() {
        let mut clock = SampleClock::new(u32::MAX - 1, 1000.0, 500.0);
        assert_eq!(clock.follow(u32::MAX, 1000.002, 500.0), Step::Later(0));
        assert_eq!(clock.follow(2, 1000.008, 500.0), Step::Later(2));
        assert!((clock.t(500.0) - 1000.008).abs() < 1e-6);
        assert_eq!(clock.follow(2, 1000.009, 500.0), Step::Repeated);
        assert_eq!(clock.follow(1, 1000.010, 500.0), Step::Repeated);
        assert_eq!(clock.follow(0, 1005.0, 500.0), Step::Anew);
        assert_eq!((clock.tick, clock.zero_s), (0, 1005.0));
        // An hour later at tick 50: it started anew in between.
        assert_eq!(clock.follow(50, 4605.0, 500.0), Step::Anew);
    }
}
