//! What a rotor's description may lack, a file for each effect; a new one is its `impl` and a
//! line in [`LIBRARY`].

mod bias;
mod bow;
mod gain;
mod misalignment;
mod runout;
mod stiffness;

use super::RotorSession;
use crate::effect::{Effect, Shape};

/// Every effect that is tried.
pub static LIBRARY: &[&dyn Effect<RotorSession>] = &[
    &bias::SensorBias,
    &runout::RUNOUT,
    &runout::SURFACE_LOBES,
    &gain::GainError,
    &bow::ShaftBow,
    &misalignment::Misalignment,
    &stiffness::BearingStiffness,
];

/// A shape that is one of several places, which the grid goes through.
const fn place(name: &'static str, unit: &'static str) -> Shape {
    Shape {
        name,
        unit,
        bounds: (0.0, f64::INFINITY),
        step: 0.0,
        logarithmic: false,
    }
}

/// The grid of so many places.
fn places(count: usize) -> Vec<Vec<f64>> {
    (0..count).map(|place| vec![place as f64]).collect()
}

/// The experiment that tells what stays from what grows with the speed squared.
pub const RUN_UP: &str = "a run-up, or constant speeds well apart, below and above a critical one";
