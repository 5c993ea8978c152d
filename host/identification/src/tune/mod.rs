//! List of the modules of `loadtwin tune` for a drivetrain, and its error type: process noise of
//! the parameters, random walks of the loads, measurement noise, hold-out comparison, two
//! minimisers.

mod differential_evolution;
mod filter_trial;
mod frequency_response;
mod holdout_comparison;
mod load_noise;
mod pattern_search;
mod report_page;
mod sampled_process_noise;
mod training_recordings;

use thiserror::Error;

pub use crate::calibrate::{MeasurementNoise, NOISE_BINS, measure_noise, rms, step_function};
pub use crate::tune::differential_evolution::Evolution;
pub use crate::tune::filter_trial::{Outcome, Trial};
pub use crate::tune::frequency_response::{FrequencyResponse, Weighting};
pub use crate::tune::holdout_comparison::{Check, Descriptions, HOLDOUT_PART, Holdout};
pub use crate::tune::load_noise::{LoadNoise, Method, Tuned, common_walk, tune_loads};
pub use crate::tune::pattern_search::pattern_search;
pub use crate::tune::report_page::{page, reached_hz};
pub use crate::tune::sampled_process_noise::sampled_process_noise;
pub use crate::tune::training_recordings::Training;
pub(crate) use crate::tune::training_recordings::starts;

use crate::calibrate::CalibrateError;
use loadtwin_design::image_build::BuildError;
use loadtwin_replay::ReplayError;

/// Why nothing can be tuned.
#[derive(Debug, Error)]
pub enum TuneError {
    /// No image can be made of the machine.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// A recording cannot be used.
    #[error(transparent)]
    Replay(#[from] ReplayError),
    /// The recordings do not say what is needed.
    #[error(transparent)]
    Calibrate(#[from] CalibrateError),
    /// The cut-off frequency is not in the range of the sample rate.
    #[error(
        "cut-off frequency: found {found} Hz, allowed: above 0, below half the sample rate, {most} Hz"
    )]
    Cutoff {
        /// What was asked for.
        found: f64,
        /// Half the sample rate.
        most: f64,
    },
    /// Nothing to hold the loads against.
    #[error(
        "--method reference: no recording has a reference load; allowed: frf, frf-per-band, innovation, \
         l-curve, likelihood"
    )]
    NoReference,
    /// No operating point has a steady filter.
    #[error(
        "no steady filter exists with these sensors at any carrier angle: a load or a state is not observed"
    )]
    NoSteadyFilter,
}
