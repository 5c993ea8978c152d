//! Processing of single signals: Butterworth filters, periodic look-up tables, angles as fractions
//! of a turn, and fast trigonometry.

pub mod butterworth;
pub mod periodic_lookup;
pub mod phase;
pub mod trigonometry;
