//! Gauges that do not sit where they are said to sit.

use rand::RngExt;
use rand_distr::StandardNormal;

use super::{Apply, Dose, Effect, Scope};
use crate::simulate::gauge::Gauge;

/// The map is turned by `1 degree s n` and scaled by `1 + 0.02 s n'`.
///
/// Source: Bosmans et al. 2023, section 4.2 (patch of candidate positions).
pub(super) const POSITION: Effect = Effect {
    name: "gauge-position",
    typical: "standard deviation of 1 degree around the carrier, and of 2 % on the response",
    apply: Apply::Gauges(Scope::Every, apply),
};

fn apply(gauges: &mut [&mut Gauge], dose: &mut Dose) {
    for gauge in gauges {
        let mut n = || dose.draw.individual.sample::<f64, _>(StandardNormal);
        gauge.shift += (dose.strength * n()).to_radians();
        gauge.gain *= 1.0 + 0.02 * dose.strength * n();
    }
}
