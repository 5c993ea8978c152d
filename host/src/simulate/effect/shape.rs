//! Strain that is not in proportion to torque.

use rand::RngExt;

use super::{Apply, Effect, Scope};
use crate::simulate::gauge::{Disturbance, Moment};

/// `(reading - offset) (1 + 0.05 s level)` on each channel, of one sign.
pub(super) const NONLINEARITY: Effect = Effect {
    name: "strain-nonlinearity",
    typical: "the response of each channel changes by 5 % from no load to nominal load",
    apply: Apply::Gauges(Scope::Every, |gauges, dose| {
        let sign = if dose.draw.individual.random() {
            1.0
        } else {
            -1.0
        };
        for gauge in gauges {
            gauge.disturbances.push(Box::new(Nonlinearity {
                part: 0.05 * dose.strength * sign,
                offset: gauge.offset,
            }));
        }
    }),
};

struct Nonlinearity {
    part: f64,
    offset: f64,
}

impl Disturbance for Nonlinearity {
    fn apply(&mut self, moment: &Moment, reading: f64) -> f64 {
        self.offset + (reading - self.offset) * (1.0 + self.part * moment.level)
    }
}
