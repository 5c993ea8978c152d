//! Counts the cycles of one load twice (`CountedLoad`): as estimated, with the bits of a board, and
//! with the noise of its estimate removed by smoothing.

use loadtwin_common::Error;
use loadtwin_common::counting::{LoadCounts, SHAFTS};

use crate::rts_smoother::{Estimate, Smoother};

/// One sample of a load.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LoadSample {
    /// The load, as a board counts it.
    pub load: f32,
    /// Standard deviation of its error, where it is an estimate.
    pub std: Option<f64>,
}

impl LoadSample {
    /// The load with its variance, where it has one.
    pub fn estimate(self) -> Option<Estimate> {
        Some(Estimate {
            load: f64::from(self.load),
            variance: self.std?.powi(2),
        })
    }
}

/// Counts of one load.
#[derive(Clone, Debug, PartialEq)]
pub struct CountedLoad {
    /// As estimated, with the bits of a board.
    pub counts: LoadCounts,
    smoothed: Option<SmoothedCounts>,
}

/// Counts of the smoothed load.
#[derive(Clone, Debug, PartialEq)]
struct SmoothedCounts {
    smoother: Smoother,
    counts: LoadCounts,
}

impl CountedLoad {
    /// With nothing counted in `empty`; `step_variance`: of a load that is an estimate, see
    /// [`crate::StepVariance`].
    pub fn new(empty: LoadCounts, step_variance: Option<f64>) -> Self {
        let smoothed = step_variance.map(|q| SmoothedCounts {
            smoother: Smoother::new(q),
            counts: empty.clone(),
        });
        Self {
            counts: empty,
            smoothed,
        }
    }

    /// Takes one sample, none where it is not valid, and the advance of each shaft (2^-32 turn).
    pub fn push(&mut self, sample: Option<LoadSample>, advance: [u32; SHAFTS]) {
        self.counts.push(sample.map(|sample| sample.load), advance);
        if let Some(SmoothedCounts { smoother, counts }) = &mut self.smoothed {
            let estimate = sample.and_then(LoadSample::estimate);
            smoother.push(estimate, |load| counts.push(Some(load as f32), [0; SHAFTS]));
        }
    }

    /// Takes a gap of samples that were never taken.
    pub fn gap(&mut self, samples: u64) {
        self.counts.gap(samples);
        self.end();
    }

    /// Counts the smoothed samples up to the last one.
    pub fn end(&mut self) {
        if let Some(SmoothedCounts { smoother, counts }) = &mut self.smoothed {
            smoother.end(|load| counts.push(Some(load as f32), [0; SHAFTS]));
        }
    }

    /// Appends the counts of a later file, after a restart.
    ///
    /// # Errors
    /// As [`LoadCounts::append`].
    pub fn append(&mut self, mut later: Self) -> Result<(), Error> {
        later.counts.restart();
        self.counts.append(&later.counts)?;
        if let (Some(earlier), Some(later)) = (&mut self.smoothed, &later.smoothed) {
            earlier.smoother.append(&later.smoother);
            earlier.counts.append(&later.counts)?;
        }
        Ok(())
    }

    /// Counts of the smoothed load and the mean variance of its error; none without standard
    /// deviations.
    pub fn smoothed(&self) -> Option<(&LoadCounts, f64)> {
        let smoothed = self.smoothed.as_ref()?;
        Some((&smoothed.counts, smoothed.smoother.variance()?))
    }
}
