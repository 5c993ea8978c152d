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

mod bearing_life;
mod counted_load;
mod counts_table;
mod damage;
mod damage_interval;
mod error;
mod file_layout;
mod gear_torque;
mod load_columns;
mod load_file;
mod load_file_error;
mod load_survey;
mod number_pair;
mod rts_smoother;
mod sn_curve;
mod spectrum;

pub use bearing_life::{RatingLife, rating_life};
pub use counted_load::{CountedLoad, LoadSample};
pub use counts_table::{COUNTS, CountsTable};
pub use damage::{EXPONENTS, damage, damage_of_cycles, equivalent_load};
pub use damage_interval::{Interval, NoiseRemoved};
pub use error::LifeError;
pub use gear_torque::equivalent_torque;
pub use load_columns::Loads;
pub use load_file::LoadFile;
pub use load_file_error::LoadFileError;
pub use load_survey::LoadSurvey;
pub use loadtwin_common::counting::GATE_LEVELS;
pub use number_pair::number_pair;
pub use rts_smoother::{Estimate, Smoother, StepVariance};
pub use sn_curve::{Beyond, SnCurve};
pub use spectrum::{LoadCycle, Spectrum, turns_at_load};
