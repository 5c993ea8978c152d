//! Errors of building a model image and of calibrating a bearing: `BuildError`.

use thiserror::Error;

use crate::rotor::RotorError;
use loadtwin_machine::MachineError;

/// Why no image can be made.
#[derive(Debug, Error)]
pub enum BuildError {
    /// The machine is of a kind that has no estimator.
    #[error("{}: found no machine to estimate loads of, allowed: a table [drivetrain], [rotor], [bearing] or [balance]", .0.display())]
    NoEstimator(std::path::PathBuf),
    /// A file that the description names cannot be used.
    #[error(transparent)]
    Machine(#[from] MachineError),
    /// There is no such set of sensors.
    #[error("no sensor set {found:?}; allowed: {allowed}")]
    NoSuchSet {
        /// What was asked for.
        found: String,
        /// What there is.
        allowed: String,
    },
    /// A map over an angle that no encoder of the set homes.
    #[error(
        "set {set:?}: found a map over the angle of {channel}, which the index of {encoder} does not home; \
         allowed: a set with {encoder}, or an [index] of an encoder of the set"
    )]
    NotHomed {
        /// The set of sensors.
        set: String,
        /// The channel with the map.
        channel: String,
        /// The encoder of the index.
        encoder: String,
    },
    /// More than an image holds.
    #[error("{0} is larger than an image can hold")]
    TooLarge(&'static str),
    /// A bearing's phases were lost on the rig.
    #[error(
        "the phases of ball passing were followed in {part:.0} % of the recording; at least {least:.0} % is needed: check gauges, wheel encoder and number of balls"
    )]
    NotFollowed {
        /// Part that was followed [%].
        part: f64,
        /// Part that is needed [%].
        least: f64,
    },
    /// The model's numbers are refused by the estimator.
    #[error("the model is refused: {0}")]
    Model(loadtwin_common::Error),
    /// There are no steady gains.
    #[error(
        "no steady gains with these sensors: {0}; allowed: --filter aekf, or sensors that observe every load"
    )]
    NotSteady(&'static str),
    /// A rotor that cannot be computed.
    #[error("rotor: {0}")]
    Rotor(#[from] RotorError),
    /// A filter that only drivetrains have.
    #[error(
        "--filter: found steady, allowed but on a drivetrain: aekf (a rotor takes the steady \
         gains of its speed by itself)"
    )]
    OnlyDrivetrains,
    /// More modes than any filter of a rotor has.
    #[error(
        "rotor.reduction.modes: found {found}, allowed: at most {most} beside the {loads} loads"
    )]
    TooManyModes {
        /// Modes that were asked for.
        found: usize,
        /// Most that there are beside the loads.
        most: usize,
        /// Number of loads.
        loads: usize,
    },
    /// A mode's speed is not observable in its displacements.
    #[error(
        "rate_hz: found a rate that samples a mode at a multiple of half its period, allowed: \
         another rate, or fewer rotor.reduction.modes"
    )]
    Sampled,
    /// The sensors do not observe a state that is to be estimated.
    #[error("no steady filter exists with these sensors: a load or a mode is not observed")]
    NotObserved,
    /// There are more sensors than one sample can carry.
    #[error(
        "{found} {what} without a sensor set; allowed: at most {most}, or a [[sensor_set]] that chooses"
    )]
    TooMany {
        /// Channels or encoders.
        what: &'static str,
        /// How many.
        found: usize,
        /// How many are allowed.
        most: usize,
    },
}
