//! Injects position errors of gauges: shifts the sensitivity map over the carrier angle and scales
//! it, by random amounts.

use rand::RngExt;
use rand_distr::StandardNormal;

use crate::injected_effect::{Apply, Dose, Effect, Scope};
use crate::simulated_gauge::Gauge;

/// The map is turned by `0.5 degrees s n` (6 mm on a ring gear of 1.4 m) and
/// scaled by `1 + 0.02 s n'`, `n` and `n'` normal.
///
/// Source: Bosmans et al. 2023, section 4.2 (patch of candidate positions).
pub(crate) const POSITION: Effect = Effect {
    name: "gauge-position",
    typical: "standard deviation of 0.5 degrees around the carrier, and of 2 % on the response",
    apply: Apply::Gauges(Scope::Every, apply),
};

fn apply(gauges: &mut [&mut Gauge], dose: &mut Dose) {
    for gauge in gauges {
        let mut n = || dose.draw.individual.sample::<f64, _>(StandardNormal);
        gauge.shift += (0.5 * dose.strength * n()).to_radians();
        gauge.gain *= 1.0 + 0.02 * dose.strength * n();
    }
}
