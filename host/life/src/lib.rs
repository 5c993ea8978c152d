//! From counts of load cycles to damage, equivalent loads and life.
//!
//! ```text
//! LoadCounts --append--> one machine over time --Spectrum::of--> cycles --merge--> several machines
//! Spectrum + SnCurve -> damage; + exponent -> damage-equivalent load
//! turns at load -> equivalent torque of a gear, equivalent load and L10 of a bearing
//! ```
#![forbid(unsafe_code)]

mod bearing;
mod damage;
mod error;
mod gear;
mod load_file;
mod sn_curve;
mod spectrum;
mod table;

pub use bearing::{RatingLife, rating_life};
pub use damage::{EXPONENTS, damage, equivalent_load};
pub use error::LifeError;
pub use gear::equivalent_torque;
pub use load_file::{LoadFile, LoadFileError, Loads};
pub use sn_curve::{Beyond, SnCurve};
pub use spectrum::{LoadCycle, Spectrum, turns_at_load};
pub use table::{COUNTS, CountsTable};
