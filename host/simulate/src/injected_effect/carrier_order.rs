//! Injects gauge errors over the carrier angle that the strain maps lack: a cosine of one order
//! from 1 to 6, and unequal load sharing of the planets.

use std::f64::consts::TAU;

use rand::RngExt;

use crate::injected_effect::{Apply, Effect, Scope};
use crate::simulated_gauge::{Disturbance, Moment};

/// `0.03 s span level cos(order angle + phase)` on each channel.
pub(crate) const CARRIER_ORDER: Effect = Effect {
    name: "carrier-order",
    typical: "3 % of the reading at nominal load over the carrier angle, order 1 to 6",
    apply: Apply::Gauges(Scope::Every, |gauges, dose| {
        let order = f64::from(dose.draw.individual.random_range(1..=6));
        for gauge in gauges {
            gauge.disturbances.push(Box::new(CarrierOrder {
                amplitude: 0.03 * dose.strength * gauge.span(),
                order,
                phase: TAU * dose.draw.individual.random::<f64>(),
            }));
        }
    }),
};

/// Planets that carry unequal parts: peaks differ from planet to planet,
///
/// `reading (1 + 0.05 s cos(angle - peak - planet 2 pi / 3))`.
pub(crate) const PLANET_SHARING: Effect = Effect {
    name: "planet-sharing",
    typical: "one planet carries 5 % more than the mean, the others in proportion less",
    apply: Apply::Gauges(Scope::Intermittent, |gauges, dose| {
        for gauge in gauges {
            let planet = f64::from(dose.draw.individual.random_range(0..3));
            gauge.disturbances.push(Box::new(PlanetSharing {
                part: 0.05 * dose.strength,
                at: gauge.shift + gauge.map.peak_angle() + planet * TAU / 3.0,
                offset: gauge.offset,
            }));
        }
    }),
};

struct CarrierOrder {
    amplitude: f64,
    order: f64,
    phase: f64,
}

impl Disturbance for CarrierOrder {
    fn apply(&mut self, moment: &Moment, reading: f64) -> f64 {
        reading + self.amplitude * moment.level * (self.order * moment.angle + self.phase).cos()
    }
}

struct PlanetSharing {
    part: f64,
    at: f64,
    offset: f64,
}

impl Disturbance for PlanetSharing {
    fn apply(&mut self, moment: &Moment, reading: f64) -> f64 {
        let factor = 1.0 + self.part * (moment.angle - self.at).cos();
        self.offset + (reading - self.offset) * factor
    }
}
