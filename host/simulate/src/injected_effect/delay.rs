//! Injects a delay of one channel against the others: its reading comes 20 ms late at strength 1.

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
