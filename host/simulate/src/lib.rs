//! Simulates recordings of a drivetrain, wheel bearing or rotor (`loadtwin simulate`): an
//! independent plant, finer than the estimator's model, on a simulated test bench with sensors and
//! converters.
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
mod bench_torques;
mod bending_load;
mod chain_parameters;
mod drivetrain_plant;
mod drivetrain_scenario;
mod error;
mod housing_temperature;
mod injected_effect;
mod injected_rotor_effect;
mod recorder;
mod rng;
mod rotor_plant;
mod simulated_bearing;
mod simulated_drivetrain;
mod simulated_encoder;
mod simulated_gauge;
mod simulated_rotor;

pub use crate::drivetrain_scenario::{Course, Demand, Scenario};
pub use crate::error::SimulateError;
pub use crate::injected_effect::{Applied, EFFECTS, Effect};
pub use crate::injected_rotor_effect::{ROTOR_EFFECTS, RotorEffect};
pub use crate::recorder::{Recorder, Sampled};
pub use crate::simulated_bearing::{
    BEARING_EFFECTS, BearingCourse, BearingEffect, BearingScenario, BearingSimulation,
};
pub use crate::simulated_drivetrain::Simulation;
pub use crate::simulated_rotor::{
    AppliedUnbalance, ROTOR_SCENARIOS, RotorCourse, RotorScenario, RotorSimulation,
};
