//! Diagnosis of drivetrains: residuals of gauges, torque balance and encoders given the shaft
//! torque; list of its modules.

pub mod candidate_effect;
pub mod chain_response;
pub mod chain_simulation;
pub mod common_mode;
pub mod decimated_signals;
pub mod decimation;
pub mod diagnosable;
pub mod gauge_median;
pub mod improved_description;
mod inserted_gear;
pub mod inverse_dynamics;
pub mod known_torques;
pub mod load_error;
mod motion_sensor;
pub mod null_simulation;
pub mod plausibility;
pub mod recorded_samples;
pub mod residual_computation;
pub mod residual_reader;
pub mod residual_signals;
