//! Injected effect: delay of a channel against the others.

use crate::injected_effect::{Apply, Effect, Scope};
use crate::simulated_gauge::Delay;

/// `y(t) = reading(t - 20 ms s)`.
pub(crate) const DELAY: Effect = Effect {
    name: "channel-delay",
    typical: "one channel comes 20 ms late",
    apply: Apply::Gauges(Scope::One, |gauges, dose| {
        for gauge in gauges {
            gauge
                .disturbances
                .push(Box::new(Delay::new(0.02 * dose.strength)));
        }
    }),
};
