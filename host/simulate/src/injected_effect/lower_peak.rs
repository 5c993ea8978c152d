//! Injects peaks of a gauge's response over the carrier angle that are lower and wider than a model
//! with point loads predicts.

use crate::injected_effect::{Apply, Effect, Scope};

/// The peaks of the map are lower and wider, with the same mean.
///
/// Source: Bosmans et al. 2023, section 4.2 (distributed contact).
pub(crate) const OVERESTIMATED: Effect = Effect {
    name: "peak-overestimated",
    typical: "peaks over the carrier angle are 10 % lower and in proportion wider",
    apply: Apply::Gauges(Scope::Intermittent, |gauges, dose| {
        for gauge in gauges {
            gauge.map = gauge.map.with_peak((1.0 - 0.1 * dose.strength).max(0.1));
        }
    }),
};
