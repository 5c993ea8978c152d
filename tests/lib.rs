//! Tests that need more than one crate or a rig; see `tests/run`.

pub mod bench;
pub mod descriptions;
pub mod emulator;
pub mod firmware;
pub mod gearbox;
pub mod rotor;
pub mod simulated;
