//! Runs the estimator sample by sample, and holds each sample until its load estimate is computed
//! where estimates lag (rotors): sample and estimate are given to the caller together.

use std::collections::VecDeque;

use loadtwin_common::estimator::Estimator;
use loadtwin_common::io::estimate::Estimate;
use loadtwin_common::io::raw::RawSample;
use serde::{Deserialize, Serialize};

use super::Sample;

/// A sample, and what was said of its sensors as it came.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct DelayedSample {
    t: f64,
    segment_t: f64,
    raw: RawSample,
    references: Vec<f64>,
    displacements: Vec<f64>,
    estimate: Estimate,
}

impl DelayedSample {
    fn new(sample: &Sample<'_>, estimate: Estimate) -> Self {
        Self {
            t: sample.t,
            segment_t: sample.segment_t,
            raw: sample.raw,
            references: sample.references.to_vec(),
            displacements: sample.displacements.to_vec(),
            estimate,
        }
    }

    fn sample(&self) -> Sample<'_> {
        Sample {
            t: self.t,
            segment_t: self.segment_t,
            raw: self.raw,
            references: &self.references,
            displacements: &self.displacements,
        }
    }
}

/// An estimator whose estimates may lag, with the samples that await their estimate. They come
/// without gaps.
pub(super) struct LagBuffer<'a> {
    line: Estimator<'a>,
    held: VecDeque<DelayedSample>,
    next_tick: u32,
}

impl<'a> LagBuffer<'a> {
    pub fn new(line: Estimator<'a>) -> Self {
        Self {
            line,
            held: VecDeque::new(),
            next_tick: 0,
        }
    }

    /// The estimator itself.
    pub fn line(&self) -> &Estimator<'a> {
        &self.line
    }

    /// The samples that await their estimate.
    pub fn held(&self) -> impl Iterator<Item = &DelayedSample> {
        self.held.iter()
    }

    /// Goes on with the estimator `line` where samples of the recording before await their
    /// estimate.
    pub fn continued(line: Estimator<'a>, held: Vec<DelayedSample>, next_tick: u32) -> Self {
        Self {
            line,
            held: held.into(),
            next_tick,
        }
    }

    /// Steps the estimator by `sample`, and gives the sample of which the load estimate is to
    /// `each`.
    pub fn push(
        &mut self,
        sample: &Sample<'_>,
        mut each: impl FnMut(&Sample<'_>, &Estimate, &Estimator<'_>),
    ) {
        let estimate = self.line.step(&sample.raw);
        self.next_tick = sample.raw.tick.wrapping_add(1);
        let lag = self.line.lag_samples();
        if lag == 0 {
            each(sample, &estimate, &self.line);
            return;
        }
        let loads = estimate.loads.clone();
        self.held.push_back(DelayedSample::new(sample, estimate));
        if self.held.len() > lag
            && let Some(mut first) = self.held.pop_front()
        {
            first.estimate.loads = loads;
            each(&first.sample(), &first.estimate, &self.line);
        }
    }

    /// Shows the last ones, after which nothing is read.
    pub fn finish(mut self, mut each: impl FnMut(&Sample<'_>, &Estimate, &Estimator<'_>)) {
        // A recording shorter than the lag has no estimate yet.
        for _ in self.held.len()..self.line.lag_samples() {
            self.read_nothing();
        }
        while let Some(mut last) = self.held.pop_front() {
            last.estimate.loads = self.read_nothing().loads;
            each(&last.sample(), &last.estimate, &self.line);
        }
    }

    fn read_nothing(&mut self) -> Estimate {
        let nothing = RawSample {
            tick: self.next_tick,
            ..RawSample::default()
        };
        self.next_tick = self.next_tick.wrapping_add(1);
        self.line.step(&nothing)
    }
}
