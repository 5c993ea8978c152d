//! Reads a file before its loads are counted, for the lowest and highest value of each load, from
//! which the range of its counts is chosen, and the variance of its steps, which its smoother needs
//! (`LoadSurvey`).

use std::path::Path;

use crate::load_file::{LoadFile, Sample};
use crate::{LoadFileError, LoadSample, Loads, StepVariance};

/// What a file has of one load.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LoadSurvey {
    /// Lowest and highest valid value; none where no sample is valid.
    pub extremes: Option<[f32; 2]>,
    /// How it moves, where it is an estimate.
    pub steps: StepVariance,
}

impl LoadSurvey {
    /// What a file has of each load, before it is counted.
    ///
    /// # Errors
    /// When the file cannot be read.
    pub fn of(path: &Path, loads: &Loads) -> Result<Vec<Self>, LoadFileError> {
        let mut found = vec![Self::default(); loads.loads.len()];
        LoadFile::open(path, loads)?.each(|sample| {
            if let Sample::Taken(loads, _) = sample {
                for (survey, load) in found.iter_mut().zip(*loads) {
                    survey.push(*load);
                }
            } else {
                for survey in &mut found {
                    survey.push(None);
                }
            }
        })?;
        Ok(found)
    }

    fn push(&mut self, sample: Option<LoadSample>) {
        if let Some(LoadSample { load, .. }) = sample {
            let [low, high] = self.extremes.unwrap_or([load; 2]);
            self.extremes = Some([low.min(load), high.max(load)]);
        }
        self.steps.push(sample.and_then(LoadSample::estimate));
    }

    /// Adds what another file has.
    pub fn add(&mut self, other: &Self) {
        let both = self.extremes.into_iter().chain(other.extremes);
        self.extremes = both.reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]);
        self.steps.add(&other.steps);
    }
}
