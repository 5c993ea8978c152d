//! Angles, tables and filters of single signals.

pub mod butterworth;
pub mod periodic_lookup;
pub mod phase;
pub mod trigonometry;
