//! Reads the first samples of recordings to tune on into memory, 20 000 of each at most: raw
//! samples and reference loads. `Training` gives the part of each that is used; the remainder is
//! held out.

use std::path::PathBuf;

use loadtwin_common::io::raw::RawSample;
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::Machine;
use loadtwin_replay::{ReplayError, Samples};

/// Samples from the start of each recording on which filters are tried.
const SAMPLES: usize = 20_000;

/// Recordings to tune on.
#[derive(Clone, Copy, Debug)]
pub struct Training<'a> {
    /// The recordings.
    pub recordings: &'a [PathBuf],
    /// The first part of each that is used, above 0 up to 1; the remainder is held out.
    pub part: f64,
}

impl<'a> Training<'a> {
    /// All of `recordings`.
    pub fn whole(recordings: &'a [PathBuf]) -> Self {
        Self {
            recordings,
            part: 1.0,
        }
    }
}

/// The first samples of a recording.
pub(crate) struct Start {
    /// What a board would have taken.
    pub raw: Vec<RawSample>,
    /// Each reference of each sample, in the load's unit; NaN where there is none.
    pub references: Vec<Vec<f64>>,
}

/// The first samples of each recording that are tried: of the part to tune on, 20 000 at most.
pub(crate) fn starts(
    machine: &Machine,
    sensors: &Sensors,
    training: Training<'_>,
) -> Result<Vec<Start>, ReplayError> {
    // So many that the part of them is not less than what is tried.
    let enough = (SAMPLES as f64 / training.part).ceil() as usize;
    let start = |recording: &PathBuf| {
        let mut samples = Samples::open(machine, sensors, recording)?;
        let (mut raw, mut references) = (Vec::new(), Vec::new());
        while raw.len() < enough
            && samples.next_block(|sample| {
                raw.push(sample.raw);
                references.push(sample.references.to_vec());
            })?
        {}
        let used = SAMPLES.min((training.part * raw.len() as f64) as usize);
        raw.truncate(used);
        references.truncate(used);
        Ok(Start { raw, references })
    };
    training.recordings.iter().map(start).collect()
}
