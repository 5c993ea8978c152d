//! Injects mains interference: adds a sinusoid near 50 Hz to the reading of each channel.

use std::f64::consts::TAU;

use rand::RngExt;

use crate::injected_effect::{Apply, Effect, Scope};
use crate::simulated_gauge::{Disturbance, Moment};

/// `0.02 s span sin(2 pi 50.02 t + phase)` on each channel; aliased where the
/// sample rate is too low for it.
pub(crate) const MAINS_INTERFERENCE: Effect = Effect {
    name: "mains-pick-up",
    typical: "50 Hz with 2 % of the reading at nominal load on each channel",
    apply: Apply::Gauges(Scope::Every, |gauges, dose| {
        for gauge in gauges {
            gauge.disturbances.push(Box::new(MainsInterference {
                amplitude: 0.02 * dose.strength * gauge.span(),
                phase: TAU * dose.draw.recording.random::<f64>(),
            }));
        }
    }),
};

/// A grid is never quite at 50 Hz.
const MAINS_HZ: f64 = 50.02;

struct MainsInterference {
    amplitude: f64,
    phase: f64,
}

impl Disturbance for MainsInterference {
    fn apply(&mut self, moment: &Moment, reading: f64) -> f64 {
        reading + self.amplitude * (TAU * MAINS_HZ * moment.t + self.phase).sin()
    }
}
