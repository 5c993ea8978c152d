//! A coupling that is not in line.

use super::places;
use crate::effect::{Coupling, Effect, Linear, Shape};
use crate::rotor::{Readings, RotorSession};

/// What a force at an end of the shaft does twice a turn, forward and backward.
///
/// Source: Gibbons, Coupling misalignment forces, Proc. 5th Turbomachinery Symposium (1976).
pub struct Misalignment;

impl Effect<RotorSession> for Misalignment {
    fn name(&self) -> &'static str {
        "misalignment"
    }
    fn about(&self) -> &'static str {
        "a coupling that is not in line pulls twice a turn"
    }
    fn coupling(&self) -> Coupling {
        Coupling::Shared
    }
    fn linear(&self) -> &'static [Linear] {
        const fn newtons(name: &'static str) -> Linear {
            Linear {
                name,
                prior_std: 10.0,
            }
        }
        const ALL: &[Linear] = &[
            newtons("forward, cosine [N]"),
            newtons("forward, sine [N]"),
            newtons("backward, cosine [N]"),
            newtons("backward, sine [N]"),
        ];
        ALL
    }
    fn shape(&self) -> &'static [Shape] {
        &[Shape {
            name: "end",
            unit: "0 is left, 1 is right",
            bounds: (0.0, 1.0),
            step: 0.0,
            logarithmic: false,
        }]
    }
    fn grid(&self, _: &RotorSession) -> Vec<Vec<f64>> {
        places(2)
    }
    fn terms(&self, session: &RotorSession, shape: &[f64]) -> Vec<Readings> {
        session.twice_a_turn(shape[0] as usize).to_vec()
    }
    fn place(&self, _: &RotorSession, shape: &[f64]) -> Option<String> {
        Some(["left end", "right end"][shape[0] as usize].into())
    }
    fn experiment(&self) -> &'static str {
        "constant speeds about half a critical one"
    }
}
