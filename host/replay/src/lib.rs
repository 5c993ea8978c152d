//! Replays a recording through the estimator (`loadtwin replay`): raw samples, estimates, error
//! figures, consistency check, report. This file has `run`, which gives each sample with its
//! estimate, and the error type.
#![forbid(unsafe_code)]
#![cfg_attr(
    not(test),
    deny(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::panic,
        clippy::unreachable,
        clippy::todo,
        clippy::unimplemented
    )
)]

mod additive_sums;
mod band_coverage;
mod bearing_baselines;
mod consistency;
mod description_comparison;
mod displacement_errors;
mod encoder_counts;
mod error_figures;
mod estimate_table;
mod index_pulse;
mod known_loads;
mod lag_buffer;
mod orbits;
mod phasor_baseline;
mod reading_correction;
mod report_page;
mod rotor_columns;
mod run;
mod samples;
mod speed_range;
mod wanted_columns;

use std::path::Path;

use loadtwin_common::estimator::Estimator;
use loadtwin_common::io::estimate::Estimate;
use thiserror::Error;

pub use additive_sums::{LoadSums, Sums, SumsReport};
pub use band_coverage::{Band, BandFigures};
pub use bearing_baselines::Baselines;
pub use consistency::{
    BIASED, CONTRADICTING, Cause, Consistency, SETTLED, SensorConsistency, SensorSums,
};
pub use description_comparison::{Change, Comparison, Course, SETTLING_S, Tendency};
pub use displacement_errors::{Displacements, NodeFigures, displacement_columns};
pub use error_figures::{Figures, LoadFigures, Whiteness};
pub use estimate_table::{ESTIMATES, EstimateRows, EstimateWriter};
pub use index_pulse::IndexError;
pub use known_loads::{RecordedError, recorded};
pub use phasor_baseline::{Phasor, PhasorFigures};
pub use report_page::ReportPage;
pub use rotor_columns::{NodeChoice, NodeColumns};
pub use run::{LARGEST_STATE, Run, STATE_MARK};
pub use samples::{Sample, Samples, has_state};
pub use speed_range::Speeds;

use loadtwin_design::image_build::{self, BuildError, Sensors};
use loadtwin_machine::Machine;
use loadtwin_recording::RecordingError;

/// Why a recording cannot be replayed.
#[derive(Debug, Error)]
pub enum ReplayError {
    /// No image can be made of the machine.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The index column holds no pulse.
    #[error(transparent)]
    Index(#[from] IndexError),
    /// The image is refused by the estimator.
    #[error("the model image is refused: {0}")]
    Image(loadtwin_common::Error),
    /// No state, or one of another run.
    #[error("{0}")]
    State(&'static str),
    /// There is nothing to compare the filter with.
    #[error(
        "--baselines: found machine {0:?}, allowed: a bearing whose calibration holds them (`loadtwin calibrate` writes them)"
    )]
    NoBaselines(String),
    /// A machine without nodes.
    #[error("--nodes: found machine {0:?}, allowed: a rotor")]
    NoNodes(String),
    /// A node that the rotor does not have.
    #[error("--nodes: found node {found}, allowed: 0 to {last}")]
    NoSuchNode {
        /// The node asked for.
        found: usize,
        /// The rotor's last one.
        last: usize,
    },
}

/// Runs the estimator of `machine` with `sensors` on the recording in `path`
/// and shows each sample and its estimate to `each`, with the part done, 0 to 1. Where estimates lag
/// ([`loadtwin_common::estimator::Estimator::lag_samples`]), a sample is shown when the estimate of it is there, with what was said of
/// its sensors as it came. Handed back is what [`Samples::notes`] has to say.
///
/// # Errors
/// When the machine or the recording cannot be used.
pub fn run(
    machine: &Machine,
    sensors: &Sensors,
    path: &Path,
    mut each: impl FnMut(&Sample<'_>, &Estimate, f64),
) -> Result<Vec<String>, ReplayError> {
    run_line(machine, sensors, path, |sample, estimate, _, part| {
        each(sample, estimate, part);
    })
}

/// As [`run`], with the estimator after its step.
///
/// # Errors
/// As [`run`].
pub fn run_line(
    machine: &Machine,
    sensors: &Sensors,
    path: &Path,
    mut each: impl FnMut(&Sample<'_>, &Estimate, &Estimator<'_>, f64),
) -> Result<Vec<String>, ReplayError> {
    let payload = image_build::image(machine, sensors)?;
    let mut run = Run::open(machine, sensors, &payload, path)?;
    loop {
        let part = run.progress();
        let more = run.next_block(|sample, estimate, line| each(sample, estimate, line, part))?;
        if !more {
            let notes = run.notes();
            run.finish(|sample, estimate, line| each(sample, estimate, line, part));
            return Ok(notes);
        }
    }
}
