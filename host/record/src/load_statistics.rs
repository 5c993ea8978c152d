//! Computes the statistics of one load over one second, as they are published: mean and extremes of
//! its values, root mean square of the standard deviations of its estimates, and the number of
//! valid samples.

use serde::Serialize;

use super::bus_rows::Load;

/// Sums over a second.
#[derive(Clone, Copy, Debug, Default)]
pub struct LoadStatistics {
    samples: u32,
    valid: u32,
    with_value: u32,
    sum: f64,
    variance_sum: f64,
    range: Option<(f64, f64)>,
}

/// A load in one second.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LoadMessage<'a> {
    /// Number of the message; a reader knows duplicates by it.
    pub sequence: u64,
    /// Begin of the second (s) since the epoch.
    pub t: u64,
    /// Name.
    pub load: &'a str,
    /// Unit.
    pub unit: &'a str,
    /// Mean of the values (in `unit`).
    pub mean: Option<f64>,
    /// Least value (in `unit`).
    pub min: Option<f64>,
    /// Largest value (in `unit`).
    pub max: Option<f64>,
    /// Root mean square of the standard deviations of the estimates (in `unit`).
    pub deviation: Option<f64>,
    /// Whether all samples are valid.
    pub valid: bool,
    /// Samples that are valid.
    pub valid_samples: u32,
    /// Samples received.
    pub samples: u32,
}

impl LoadStatistics {
    /// Adds a sample.
    pub fn push(&mut self, load: &Load) {
        self.samples += 1;
        self.valid += u32::from(load.fault.is_none());
        let (Some(value), Some(std)) = (load.value, load.std) else {
            return;
        };
        self.with_value += 1;
        self.sum += value;
        self.variance_sum += std * std;
        let (least, most) = self.range.unwrap_or((value, value));
        self.range = Some((least.min(value), most.max(value)));
    }

    /// The message; none without samples.
    pub fn message<'a>(
        &self,
        sequence: u64,
        t: u64,
        (load, unit): (&'a str, &'a str),
    ) -> Option<LoadMessage<'a>> {
        let n = f64::from(self.with_value);
        let has_value = self.with_value > 0;
        (self.samples > 0).then_some(LoadMessage {
            sequence,
            t,
            load,
            unit,
            mean: has_value.then(|| self.sum / n),
            min: self.range.map(|range| range.0),
            max: self.range.map(|range| range.1),
            deviation: has_value.then(|| (self.variance_sum / n).sqrt()),
            valid: self.valid == self.samples,
            valid_samples: self.valid,
            samples: self.samples,
        })
    }
}
