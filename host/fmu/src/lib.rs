//! The estimator as a co-simulation FMU (FMI 3.0 and 2.0), packed by `loadtwin build --fmu`; this
//! crate is also the shared library that runs it.
//!
//! The machine is data: model image and description of the inputs lie in the FMU's resources, and
//! one library serves every machine. `abi` has the C functions over [`instance::Instance`].
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

mod abi;
mod file_uri;
mod inputs;
pub mod instance;
pub mod interface;
pub mod library;
mod model_description;
pub mod package;
pub mod refusal;
pub mod resources;
pub mod role;
mod saved_state;
mod unit;
pub mod variable;
