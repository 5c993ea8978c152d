//! A shaft that is bent.

use super::{RUN_UP, place, places};
use crate::effect::{Coupling, Effect, Linear, Shape};
use crate::rotor::{Readings, RotorSession};

/// What a force that turns with the shaft and is the same at every speed does, at the node of a
/// load: a shaft that is bent as such a force would bend it.
///
/// Source: Nicholas, Gunter, Allaire, Effect of residual shaft bow on unbalance response,
/// J. Eng. Power 98 (1976).
pub struct ShaftBow;

impl Effect<RotorSession> for ShaftBow {
    fn name(&self) -> &'static str {
        "shaft-bow"
    }
    fn about(&self) -> &'static str {
        "the shaft is bent where nothing acts on it"
    }
    fn coupling(&self) -> Coupling {
        Coupling::Shared
    }
    fn linear(&self) -> &'static [Linear] {
        &[
            Linear {
                name: "cosine of the force that would bend it so [N]",
                prior_std: 10.0,
            },
            Linear {
                name: "sine of the force that would bend it so [N]",
                prior_std: 10.0,
            },
        ]
    }
    fn shape(&self) -> &'static [Shape] {
        const PLACE: &[Shape] = &[place("load", "from 0")];
        PLACE
    }
    fn grid(&self, session: &RotorSession) -> Vec<Vec<f64>> {
        places(session.rotor().loads.len())
    }
    fn terms(&self, session: &RotorSession, shape: &[f64]) -> Vec<Readings> {
        session.bow(shape[0] as usize).to_vec()
    }
    fn place(&self, session: &RotorSession, shape: &[f64]) -> Option<String> {
        let load = &session.rotor().loads[shape[0] as usize];
        Some(format!("node {}", load.node))
    }
    fn experiment(&self) -> &'static str {
        RUN_UP
    }
}
