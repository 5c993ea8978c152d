//! Sums up the estimates of a replay so that the sums of several recordings add up, for the
//! archive: validity, extremes and sum of each load, consistency and faults of each sensor.

use std::collections::BTreeMap;

use loadtwin_common::io::estimate::{Estimate, LoadEstimate};
use serde::Serialize;

use super::consistency::{SensorConsistency, SensorSums};
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::Machine;

/// Sums of one load.
#[derive(Clone, Debug, Serialize)]
pub struct LoadSums {
    /// Its name.
    pub name: String,
    /// Unit of `lowest`, `highest` and `sum`.
    pub unit: String,
    /// Samples in which it is valid.
    pub valid: u64,
    /// Lowest valid value.
    pub lowest: Option<f32>,
    /// Highest valid value.
    pub highest: Option<f32>,
    /// Sum of the valid values.
    pub sum: f64,
    /// How often each fault was flagged.
    pub flags: BTreeMap<&'static str, u64>,
}

impl LoadSums {
    fn push(&mut self, load: &LoadEstimate) {
        if !load.fault.is_none() {
            *self.flags.entry(load.fault.name()).or_default() += 1;
            return;
        }
        self.valid += 1;
        self.sum += f64::from(load.value);
        let (low, high) = (self.lowest, self.highest);
        self.lowest = Some(low.map_or(load.value, |low| low.min(load.value)));
        self.highest = Some(high.map_or(load.value, |high| high.max(load.value)));
    }
}

/// Sums of a replay.
#[derive(Clone, Debug)]
pub struct Sums {
    samples: u64,
    valid: u64,
    span_s: Option<[f64; 2]>,
    loads: Vec<LoadSums>,
    sensors: Vec<SensorConsistency>,
}

/// As [`Sums`], to be written.
#[derive(Clone, Debug, Serialize)]
pub struct SumsReport {
    /// Samples.
    pub samples: u64,
    /// Samples in which at least one load is valid.
    pub valid: u64,
    /// Time of the first and of the last sample (s).
    pub span_s: Option<[f64; 2]>,
    /// Each load.
    pub loads: Vec<LoadSums>,
    /// Each sensor in the order of the estimates.
    pub sensors: Vec<SensorSums>,
}

impl Sums {
    /// Nothing summed up yet.
    pub fn new(machine: &Machine, sensors: &Sensors) -> Self {
        let loads = machine.loads().into_iter().map(|load| LoadSums {
            name: load.name.to_owned(),
            unit: load.unit.to_string(),
            valid: 0,
            lowest: None,
            highest: None,
            sum: 0.0,
            flags: BTreeMap::new(),
        });
        Self {
            samples: 0,
            valid: 0,
            span_s: None,
            loads: loads.collect(),
            sensors: SensorConsistency::all(sensors),
        }
    }

    /// Adds the estimate of the sample at time `t` (s).
    pub fn push(&mut self, t: f64, estimate: &Estimate) {
        self.samples += 1;
        let is_valid = estimate.loads.iter().any(|load| load.fault.is_none());
        self.valid += u64::from(is_valid);
        self.span_s = Some([self.span_s.map_or(t, |[first, _]| first), t]);
        for (sums, load) in self.loads.iter_mut().zip(&estimate.loads) {
            sums.push(load);
        }
        for (sums, read) in self.sensors.iter_mut().zip(&estimate.sensors) {
            sums.push(read);
        }
    }

    /// What was summed up.
    pub fn report(self) -> SumsReport {
        SumsReport {
            samples: self.samples,
            valid: self.valid,
            span_s: self.span_s,
            loads: self.loads,
            sensors: self.sensors.iter().map(SensorConsistency::sums).collect(),
        }
    }
}
