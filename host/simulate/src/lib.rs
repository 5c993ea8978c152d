//! Simulated recordings of a drivetrain, wheel bearing or rotor: an independent plant, finer than
//! the estimator's model, on a simulated test bench with sensors and converters.
//!
//! Nothing here is shared with the estimator but the machine description.
//! What the plant does beyond that description, its [`EFFECTS`], is not
//! written into the recording.
//!
//! ```
//! use std::path::Path;
//! # use loadtwin_machine::Machine;
//! # use loadtwin_simulate::{Applied, Scenario, Simulation};
//! # let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../examples/gearbox/machine.toml"));
//! let machine = Machine::load(path)?;
//! let mut scenario = Scenario::by_name("constant")?;
//! scenario.duration_s = 0.2;
//! let effects = ["gain-error=0.5".parse::<Applied>()?];
//! let simulation = Simulation::new(&machine, &scenario, 1, None, &effects)?;
//! assert_eq!(simulation.rows(), 100);
//! let samples: usize = simulation.map(|block| block.t.len()).sum();
//! assert_eq!(samples, 100);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::unreachable,
        clippy::todo,
        clippy::unimplemented
    )
)]

mod angle_function;
mod bearing;
mod bending;
mod chain;
mod drivetrain;
mod effect;
mod encoder;
mod error;
mod gauge;
mod plant;
mod recorder;
mod rng;
mod rotor;
mod rotor_effect;
mod rotor_plant;
mod scenario;
mod test_bench;
mod thermal;

pub use crate::bearing::{
    BEARING_EFFECTS, BearingCourse, BearingEffect, BearingScenario, BearingSimulation,
};
pub use crate::drivetrain::Simulation;
pub use crate::effect::{Applied, EFFECTS, Effect};
pub use crate::error::SimulateError;
pub use crate::recorder::{Recorder, Sampled};
pub use crate::rotor::{
    AppliedUnbalance, ROTOR_SCENARIOS, RotorCourse, RotorScenario, RotorSimulation,
};
pub use crate::rotor_effect::{ROTOR_EFFECTS, RotorEffect};
pub use crate::scenario::{Course, Demand, Scenario};
