//! A recording with every load known, as calibration and diagnosis take it.

use std::path::{Path, PathBuf};

use loadtwin_common::bearing::LOADS;
use thiserror::Error;

use crate::{ReplayError, Samples};
use loadtwin_design::bearing::RigSample;
use loadtwin_design::build::Sensors;
use loadtwin_machine::{BEARING_LOADS, Machine};

/// Why the loads of a recording are not known.
#[derive(Debug, Error)]
pub enum RecordedError {
    /// The description names no reference of a load.
    #[error("{}: no [[reference]] of load {load}: all five are needed", machine.display())]
    Reference {
        /// The description.
        machine: PathBuf,
        /// The load.
        load: &'static str,
    },
    /// The recording cannot be read.
    #[error(transparent)]
    Replay(#[from] ReplayError),
}

/// The samples of `path` with their loads.
///
/// # Errors
/// [`RecordedError`] when a load has no reference or the recording cannot be read.
pub fn recorded(
    machine: &Machine,
    sensors: &Sensors,
    path: &Path,
) -> Result<Vec<RigSample>, RecordedError> {
    let mut column = [0; LOADS];
    for (column, load) in column.iter_mut().zip(BEARING_LOADS) {
        let found = machine.references.iter().position(|r| r.load == load);
        *column = found.ok_or_else(|| RecordedError::Reference {
            machine: machine.path.clone(),
            load,
        })?;
    }
    let mut samples = Vec::new();
    let mut reader = Samples::open(machine, sensors, path)?;
    while reader.next_block(|sample| {
        samples.push((sample.raw, column.map(|i| sample.references[i])));
    })? {}
    Ok(samples)
}
