//! Injects an eccentric encoder disc: an error of the angle that one encoder counts, once per
//! revolution.

use std::f64::consts::TAU;

use rand::RngExt;

use crate::injected_effect::{Apply, Effect};

/// `0.002 rad s cos(angle - phase)` on the angle that one encoder counts.
pub(crate) const ECCENTRICITY: Effect = Effect {
    name: "encoder-eccentricity",
    typical: "the first encoder errs by 2 mrad once per turn",
    apply: Apply::Encoder(|encoder, dose| {
        encoder.eccentricity = 0.002 * dose.strength;
        encoder.eccentric_at = TAU * dose.draw.individual.random::<f64>();
    }),
};
