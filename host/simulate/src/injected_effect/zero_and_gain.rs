//! Injects errors of zero and gain into simulated gauges: an offset, a gain error, a gain that
//! changes with temperature.

use rand::RngExt;
use rand_distr::StandardNormal;

use crate::injected_effect::{Apply, Dose, Effect, Scope};
use crate::simulated_gauge::{Disturbance, Moment};

/// A zero that is not the one described.
pub(crate) const OFFSET: Effect = Effect {
    name: "gauge-offset",
    typical: "standard deviation of 0.5 % of the reading at nominal load",
    apply: Apply::Gauges(Scope::Every, |gauges, dose| {
        for gauge in gauges {
            let n: f64 = dose.draw.individual.sample(StandardNormal);
            gauge.offset += 0.005 * dose.strength * n * gauge.span();
        }
    }),
};

/// A gain that is not the one described: gauge factor, lead resistance.
pub(crate) const GAIN: Effect = Effect {
    name: "gain-error",
    typical: "one channel reads 5 % too much or too little",
    apply: Apply::Gauges(Scope::One, |gauges, dose| {
        for gauge in gauges {
            gauge.gain *= 1.0 + 0.05 * dose.strength * sign(dose);
        }
    }),
};

/// A gain that changes with temperature.
pub(crate) const THERMAL: Effect = Effect {
    name: "thermal-gain",
    typical: "the reading of each channel changes by 2 % per kelvin",
    apply: Apply::Gauges(Scope::Every, |gauges, dose| {
        let sign = sign(dose);
        for gauge in gauges {
            let (per_kelvin, offset) = (0.02 * dose.strength * sign, gauge.offset);
            gauge
                .disturbances
                .push(Box::new(ThermalGain { per_kelvin, offset }));
        }
    }),
};

fn sign(dose: &mut Dose) -> f64 {
    if dose.draw.individual.random() {
        1.0
    } else {
        -1.0
    }
}

struct ThermalGain {
    per_kelvin: f64,
    offset: f64,
}

impl Disturbance for ThermalGain {
    fn apply(&mut self, moment: &Moment, reading: f64) -> f64 {
        let factor = 1.0 + self.per_kelvin * moment.warming;
        self.offset + (reading - self.offset) * factor
    }
}
