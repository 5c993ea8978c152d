//! A channel that lags behind the others.

use std::collections::VecDeque;

use super::{Apply, Effect, Scope};
use crate::simulate::gauge::{Disturbance, Moment};

/// `y(t) = reading(t - 20 ms s)`, between samples by straight lines.
pub(super) const DELAY: Effect = Effect {
    name: "channel-delay",
    typical: "one channel comes 20 ms late",
    apply: Apply::Gauges(Scope::One, |gauges, dose| {
        for gauge in gauges {
            gauge.disturbances.push(Box::new(Delay {
                seconds: 0.02 * dose.strength,
                past: VecDeque::new(),
            }));
        }
    }),
};

struct Delay {
    seconds: f64,
    /// The newest reading first.
    past: VecDeque<f64>,
}

impl Disturbance for Delay {
    fn apply(&mut self, moment: &Moment, reading: f64) -> f64 {
        let samples = self.seconds / moment.dt;
        let (whole, part) = (samples.floor() as usize, samples.fract());
        self.past.push_front(reading);
        self.past.truncate(whole + 2);
        // Before the start it stood where it started.
        let at = |i: usize| {
            self.past
                .get(i)
                .or(self.past.back())
                .copied()
                .unwrap_or(reading)
        };
        at(whole) * (1.0 - part) + at(whole + 1) * part
    }
}
