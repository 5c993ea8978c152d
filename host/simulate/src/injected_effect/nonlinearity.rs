//! Injects a nonlinear response of gauges: the strain is not in proportion to the torque.

use rand::RngExt;

use crate::injected_effect::{Apply, Effect, Scope};

/// `map s (1 + 0.05 strength s / nominal)` on each channel, of one sign.
pub(crate) const NONLINEARITY: Effect = Effect {
    name: "strain-nonlinearity",
    typical: "the response of each channel changes by 5 % from no load to nominal load",
    apply: Apply::Gauges(Scope::Every, |gauges, dose| {
        let sign = if dose.draw.individual.random() {
            1.0
        } else {
            -1.0
        };
        for gauge in gauges {
            gauge.nonlinearity += 0.05 * dose.strength * sign;
        }
    }),
};
