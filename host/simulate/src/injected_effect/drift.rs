//! Injects slow drift into simulated gauge readings: creep under load (30 s), and a zero that
//! drifts with temperature.

use rand::RngExt;
use rand_distr::StandardNormal;

use crate::injected_effect::{Apply, Dose, Effect, Scope};
use crate::simulated_gauge::{Creep, Disturbance, Gauge, Moment};

/// `dz/dt = (amplitude level - z) / 30 s`, added to each channel of the group
/// that responds least.
///
/// The amplitude is nearly the same on all its channels. On a group that reads
/// 40 micrometre/m at nominal load: 5 micrometre/m in the end.
///
/// Source: Bosmans et al. 2023, section 6.2.3.
pub(crate) const CREEP: Effect = Effect {
    name: "gauge-creep",
    typical: "12 % of the group's mean reading at nominal load in the end, 30 s time constant",
    apply: Apply::Gauges(Scope::WeakestGroup, |gauges, dose| {
        let mean = mean_span(gauges);
        for gauge in gauges {
            let n: f64 = dose.draw.individual.sample(StandardNormal);
            let amplitude = 0.12 * dose.strength * mean * (1.0 + 0.1 * n);
            gauge
                .disturbances
                .push(Box::new(Creep::new(loadtwin_machine::Creep {
                    at_nominal: amplitude,
                    time_s: CREEP_TIME_S,
                })));
        }
    }),
};

/// `coefficient (T - T0)` on each channel.
pub(crate) const THERMAL: Effect = Effect {
    name: "thermal-drift",
    typical: "2 % of the mean reading at nominal load per kelvin",
    apply: Apply::Gauges(Scope::Every, thermal),
};

fn mean_span(gauges: &[&mut Gauge]) -> f64 {
    gauges.iter().map(|g| g.span()).sum::<f64>() / gauges.len().max(1) as f64
}

/// Time constant of the creep [s].
const CREEP_TIME_S: f64 = 30.0;

struct Thermal {
    per_kelvin: f64,
}

impl Disturbance for Thermal {
    fn apply(&mut self, moment: &Moment, reading: f64) -> f64 {
        reading + self.per_kelvin * moment.warming
    }
}

fn thermal(gauges: &mut [&mut Gauge], dose: &mut Dose) {
    for gauge in gauges {
        let part: f64 = dose.draw.individual.random_range(0.7..1.3);
        let per_kelvin = 0.02 * dose.strength * gauge.span() * part;
        gauge.disturbances.push(Box::new(Thermal { per_kelvin }));
    }
}
