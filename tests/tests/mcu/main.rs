//! The emulated Cortex-M4F and the checks on the firmware's binaries: one binary,
//! so that two boards run at a time.

mod campaign;
mod descriptions;
mod ends;
mod image;
mod line;
mod panic;
mod stack;
mod steps;
