//! Fatigue evaluation of loads: counts of load cycles from files; from these damage,
//! damage-equivalent loads, equivalent gear torque and bearing life.
//!
//! ```text
//! estimates --CountedLoad--> LoadCounts as on a board, and of the load with its noise removed
//! LoadCounts --append--> one machine over time --Spectrum::of--> cycles --merge--> several machines
//! Spectrum + SnCurve -> damage; + exponent -> damage-equivalent load
//! turns at load -> equivalent torque of a gear, equivalent load and L10 of a bearing
//! ```
#![forbid(unsafe_code)]

mod bearing;
mod counted_load;
mod damage;
mod error;
mod gear;
mod interval;
mod load_columns;
mod load_error;
mod load_file;
mod smoother;
mod sn_curve;
mod spectrum;
mod survey;
mod table;

pub use bearing::{RatingLife, rating_life};
pub use counted_load::{CountedLoad, LoadSample};
pub use damage::{EXPONENTS, damage, equivalent_load};
pub use error::LifeError;
pub use gear::equivalent_torque;
pub use interval::{Interval, NoiseRemoved};
pub use load_columns::Loads;
pub use load_error::LoadFileError;
pub use load_file::LoadFile;
pub use smoother::{Estimate, Smoother, StepVariance};
pub use sn_curve::{Beyond, SnCurve};
pub use spectrum::{LoadCycle, Spectrum, turns_at_load};
pub use survey::LoadSurvey;
pub use table::{COUNTS, CountsTable};
