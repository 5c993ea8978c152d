//! A surface that is out of true.

use super::{RUN_UP, place, places};
use crate::diagnose::effect::{Coupling, Effect, Linear, Shape};
use crate::diagnose::rotor::{Readings, RotorSession};

/// `a cos(angle - d) - b sin(angle - d)` in the sensors at one node, along their directions `d`:
/// once a turn, of the same size at every speed.
pub struct Runout;

impl Effect<RotorSession> for Runout {
    fn name(&self) -> &'static str {
        "runout"
    }
    fn about(&self) -> &'static str {
        "the surface that sensors look at is out of true"
    }
    fn coupling(&self) -> Coupling {
        Coupling::Shared
    }
    fn linear(&self) -> &'static [Linear] {
        &[
            Linear {
                name: "cosine [m]",
                prior_std: 5e-5,
            },
            Linear {
                name: "sine [m]",
                prior_std: 5e-5,
            },
        ]
    }
    fn shape(&self) -> &'static [Shape] {
        const PLACE: &[Shape] = &[place("node", "of those with sensors")];
        PLACE
    }
    fn grid(&self, session: &RotorSession) -> Vec<Vec<f64>> {
        places(session.nodes().len())
    }
    fn terms(&self, session: &RotorSession, shape: &[f64]) -> Vec<Readings> {
        let node = session.nodes()[shape[0] as usize];
        let wave = |of: fn(f64) -> f64| {
            session.each(|k, i| match session.place(k) {
                (at, direction) if at == node => of(session.turning().angle[i] - direction),
                _ => 0.0,
            })
        };
        vec![wave(f64::cos), wave(|angle| -angle.sin())]
    }
    fn place(&self, session: &RotorSession, shape: &[f64]) -> Option<String> {
        Some(format!("node {}", session.nodes()[shape[0] as usize]))
    }
    fn experiment(&self) -> &'static str {
        RUN_UP
    }
}
