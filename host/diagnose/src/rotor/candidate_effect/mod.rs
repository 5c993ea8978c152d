//! Effects that the description of a rotor may lack, one file each. A new effect is its `impl` and
//! a line in `LIBRARY`.

mod bias;
mod bow;
mod gain;
mod misalignment;
mod runout;
mod stiffness;

use crate::candidate_effect::{Effect, NonlinearParameter};
use crate::rotor::RotorResiduals;

/// Every effect that is tried.
pub static LIBRARY: &[&dyn Effect<RotorResiduals>] = &[
    &bias::SensorBias,
    &runout::RUNOUT,
    &runout::SURFACE_LOBES,
    &gain::GainError,
    &bow::ShaftBow,
    &misalignment::Misalignment,
    &stiffness::BearingStiffness,
];

/// A shape that is one of several places, which the grid goes through.
const fn location_parameter(name: &'static str, unit: &'static str) -> NonlinearParameter {
    NonlinearParameter {
        name,
        unit,
        bounds: (0.0, f64::INFINITY),
        step: 0.0,
        logarithmic: false,
    }
}

/// The grid of so many places.
fn location_grid(count: usize) -> Vec<Vec<f64>> {
    (0..count)
        .map(|location_parameter| vec![location_parameter as f64])
        .collect()
}

/// The experiment that separates constant forces from those that grow with the speed squared.
pub const RUN_UP: &str = "a run-up, or constant speeds well apart, below and above a critical one";
