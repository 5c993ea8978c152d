//! Test program of the emulated Cortex-M4F and of the firmware's binaries: bits, faults, uploads,
//! stack, panics, instructions.

mod burst;
mod campaign;
mod counts;
mod descriptions;
mod ends;
mod image;
mod line;
mod panic;
mod sizes;
mod stack;
mod steps;
