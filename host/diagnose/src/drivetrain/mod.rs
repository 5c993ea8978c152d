//! Drivetrains: residuals of gauges, torque balance and encoders given the shaft torque.

pub mod backlash_response;
pub mod chain_response;
pub mod common_mode;
pub mod context;
pub mod decimation;
pub mod diagnosable;
pub mod effect;
pub mod gauge_median;
pub mod inverse_dynamics;
pub mod known_torques;
pub mod load_error;
pub mod null_distribution;
pub mod plausibility;
pub mod read;
pub mod recording;
pub mod residuals;
pub mod signals;
pub mod write;
