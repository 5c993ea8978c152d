//! `loadtwin replay`: the estimator on a recording.

mod estimates;
mod figures;
mod page;
mod samples;

use std::path::Path;

use loadtwin_common::estimate::Estimate;
use loadtwin_common::image::Image;
use loadtwin_common::line::Line;
use loadtwin_common::raw::RawSample;
use thiserror::Error;

pub use estimates::EstimateWriter;
pub use figures::{Figures, LoadFigures};
pub use page::ReportPage;
pub use samples::{Sample, Samples};

use crate::build::{self, BuildError, Sensors};
use crate::machine::{Kind, Machine};
use crate::recording::RecordingError;

/// Why a recording cannot be replayed.
#[derive(Debug, Error)]
pub enum ReplayError {
    /// No image can be made of the machine.
    #[error(transparent)]
    Build(#[from] BuildError),
    /// The recording cannot be read.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The image is refused by the estimator.
    #[error("the model image is refused: {0}")]
    Image(loadtwin_common::Error),
}

/// Runs the estimator of `machine` with `sensors` on the recording in `path`
/// and shows each sample and its estimate to `each`, with the part done, 0 to 1.
///
/// # Errors
/// When the machine or the recording cannot be used.
pub fn run(
    machine: &Machine,
    sensors: &Sensors,
    path: &Path,
    each: impl FnMut(&Sample<'_>, &Estimate, f64),
) -> Result<(), ReplayError> {
    if let Some(Kind::Bearing(bearing)) = machine.kind() {
        let filter = crate::bearing::estimator(machine, bearing, sensors)?;
        let mut state = filter.start();
        let samples = Samples::open(machine, sensors, path)?;
        return every(samples, |raw| filter.step(&mut state, raw), each);
    }
    let payload = build::image(machine, sensors)?;
    let image = Image::from_bytes(&payload).map_err(ReplayError::Image)?;
    let mut line = Line::try_build(image).map_err(ReplayError::Image)?;
    let samples = Samples::open(machine, sensors, path)?;
    every(samples, |raw| line.step(raw), each)
}

/// Shows every sample and what `step` makes of it to `each`.
fn every(
    mut samples: Samples,
    mut step: impl FnMut(&RawSample) -> Estimate,
    mut each: impl FnMut(&Sample<'_>, &Estimate, f64),
) -> Result<(), ReplayError> {
    loop {
        let progress = samples.progress();
        let more = samples.next_block(|sample| each(sample, &step(&sample.raw), progress))?;
        if !more {
            return Ok(());
        }
    }
}
