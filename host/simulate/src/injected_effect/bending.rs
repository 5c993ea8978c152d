//! Injects a bending load that the model lacks: one load, constant and with slow random parts
//! (below 0.5 Hz), that every gauge reads in addition, each with its own factor, whatever the
//! torque.

use std::sync::Arc;

use rand::RngExt;

use crate::drivetrain_scenario::Waves;
use crate::injected_effect::{Apply, Effect, Scope};
use crate::simulated_gauge::{Disturbance, Moment};

/// `part span (level of bending)`, the same load on all channels: a constant
/// and what varies below 0.5 Hz.
///
/// Its signs are not those of torque: it is symmetric where torque is not.
pub(crate) const BENDING: Effect = Effect {
    name: "bending-load",
    typical: "a load below 0.5 Hz that each channel reads as 5 % of nominal (standard deviation)",
    apply: Apply::Gauges(Scope::Every, |gauges, dose| {
        let waves = Arc::new(Waves::new(0.01, 0.5, &mut dose.draw.recording));
        for gauge in gauges {
            let part: f64 = dose.draw.individual.random_range(0.7..1.3);
            gauge.disturbances.push(Box::new(Bending {
                amplitude: 0.05 * dose.strength * gauge.span() * part,
                waves: Arc::clone(&waves),
            }));
        }
    }),
};

struct Bending {
    amplitude: f64,
    waves: Arc<Waves>,
}

impl Disturbance for Bending {
    fn apply(&mut self, moment: &Moment, reading: f64) -> f64 {
        reading + self.amplitude * (0.5 + self.waves.at(moment.t))
    }
}
