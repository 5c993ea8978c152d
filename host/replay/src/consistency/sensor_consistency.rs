//! Compares the readings of one sensor with the filter's predictions over a replay: share of
//! contradicting readings, bias and NIS of the innovations, least-squares gain and offset, flagged
//! faults. Decides whether the sensor disagrees with the description.

use std::collections::BTreeMap;

use loadtwin_common::io::estimate::SensorEstimate;
use loadtwin_common::io::fault::Fault;
use loadtwin_design::image_build::Sensors;
use serde::Serialize;

use super::{BEYOND, CONTRADICTING, Cause, SETTLED, percent};

/// Mean innovation from which a zero or a sensitivity is off [standard deviations]: where it is
/// half of what the filter expects of noise and model error together, an error of the
/// description is a fifth of their mean square.
pub const BIASED: f64 = 0.5;

/// Part of the readings that are missing, saturated or stuck from which that is the cause.
const MOSTLY: f64 = 0.5;

/// One sensor against the model.
#[derive(Clone, Debug, Default, Serialize)]
pub struct SensorConsistency {
    /// Its name.
    pub name: String,
    /// Readings that were compared with a prediction.
    pub compared: u64,
    /// Those of them beyond three standard deviations, or flagged as contradicting the other
    /// sensors [%]; 0.27 in a consistent filter.
    pub contradicting_percent: Option<f64>,
    /// Mean normalised innovation squared, of those used; 1 in a consistent filter.
    pub nis: Option<f64>,
    /// Mean innovation over its standard deviation, of those used; 0 in a consistent filter.
    pub bias: Option<f64>,
    /// Gain and offset [SI unit] of the readings over the predicted ones, by least squares.
    pub line: Option<[f64; 2]>,
    /// Mean of the readings minus the predicted ones [SI unit].
    pub zero: Option<f64>,
    /// How often each fault was flagged.
    pub flags: BTreeMap<&'static str, u64>,
    #[serde(skip)]
    contradicting: u64,
    #[serde(skip)]
    used: u64,
    #[serde(skip)]
    sums: [f64; 2],
    #[serde(skip)]
    regression: Regression,
}

/// Sums of one sensor, which add up over recordings.
#[derive(Clone, Debug, Serialize)]
pub struct SensorSums {
    /// Its name.
    pub name: String,
    /// Readings that were compared with a prediction.
    pub compared: u64,
    /// Those of them that contradict the model or the other sensors.
    pub contradicting: u64,
    /// Readings that were used.
    pub used: u64,
    /// Innovations over their standard deviation, of those used.
    pub bias: f64,
    /// Normalised innovations squared, of those used.
    pub nis: f64,
    /// How often each fault was flagged.
    pub flags: BTreeMap<&'static str, u64>,
}

/// Running means and second moments of predicted and read values.
#[derive(Clone, Copy, Debug, Default)]
struct Regression {
    count: f64,
    predicted: f64,
    read: f64,
    variance: f64,
    covariance: f64,
}

impl Regression {
    fn push(&mut self, predicted: f64, read: f64) {
        self.count += 1.0;
        let off = predicted - self.predicted;
        self.predicted += off / self.count;
        self.read += (read - self.read) / self.count;
        self.variance += off * (predicted - self.predicted);
        self.covariance += off * (read - self.read);
    }

    fn line(&self) -> Option<[f64; 2]> {
        let gain = self.covariance / self.variance;
        let is_line = gain.is_finite() && gain != 0.0;
        is_line.then_some([gain, self.read - gain * self.predicted])
    }
}

/// Whether a reading contradicts the model; none where it was not compared.
pub(super) fn contradicts(read: &SensorEstimate) -> Option<bool> {
    let by_others = matches!(
        read.fault,
        Fault::Erratic
            | Fault::Slipped
            | Fault::Dead
            | Fault::Implausible
            | Fault::Gain
            | Fault::Reversed
            | Fault::Swapped
            | Fault::Offset
            | Fault::Drift
            | Fault::Contradicted
    );
    let is_compared = read.innovation_variance > 0.0;
    (by_others || is_compared).then_some(by_others || read.nis > BEYOND)
}

impl SensorConsistency {
    pub(super) fn named(name: String) -> Self {
        Self {
            name,
            ..Self::default()
        }
    }

    /// Those of all sensors in the order of the estimates, nothing gathered yet.
    pub(crate) fn all(sensors: &Sensors) -> Vec<Self> {
        sensors.names().into_iter().map(Self::named).collect()
    }

    /// What adds up over recordings.
    pub(crate) fn sums(&self) -> SensorSums {
        SensorSums {
            name: self.name.clone(),
            compared: self.compared,
            contradicting: self.contradicting,
            used: self.used,
            bias: self.sums[0],
            nis: self.sums[1],
            flags: self.flags.clone(),
        }
    }

    pub(crate) fn push(&mut self, read: &SensorEstimate) {
        if !read.fault.is_none() {
            *self.flags.entry(read.fault.name()).or_default() += 1;
        }
        if let Some(contradicts) = contradicts(read) {
            self.compared += 1;
            self.contradicting += u64::from(contradicts);
        }
        if read.innovation_variance > 0.0 {
            let (measured, innovation) = (f64::from(read.measured), f64::from(read.innovation));
            self.regression.push(measured - innovation, measured);
            if read.fault.is_none() {
                self.used += 1;
                self.sums[0] += innovation / f64::from(read.innovation_variance).sqrt();
                self.sums[1] += f64::from(read.nis);
            }
        }
    }

    pub(super) fn sum_up(&mut self) {
        self.contradicting_percent = percent(self.contradicting, self.compared);
        let mean = |sum: f64| (self.used > 0).then(|| sum / self.used as f64);
        self.bias = mean(self.sums[0]);
        self.nis = mean(self.sums[1]);
        self.line = self.regression.line();
        let compared = self.regression.count > 0.0;
        self.zero = compared.then_some(self.regression.read - self.regression.predicted);
    }

    /// Readings so far that contradict the model.
    pub(super) fn contradicting(&self) -> u64 {
        self.contradicting
    }

    /// The part of all.
    pub(super) fn part_contradicting(&self) -> f64 {
        self.contradicting as f64 / self.compared.max(1) as f64
    }

    /// Whether its readings contradict the description.
    pub(super) fn disagrees(&self) -> bool {
        let biased = self.used > SETTLED && self.bias.is_some_and(|bias| bias.abs() > BIASED);
        let contradicts =
            self.contradicting >= SETTLED && self.part_contradicting() > CONTRADICTING;
        biased || contradicts
    }

    /// By how much they do, in words.
    pub(super) fn disagreement(&self) -> String {
        if self.part_contradicting() > CONTRADICTING {
            let part = 100.0 * self.part_contradicting();
            return format!(
                "{part:.0} % of the readings of {} contradict the model (expected 0.3 %); ",
                self.name
            );
        }
        let bias = self.bias.unwrap_or(0.0);
        format!(
            "{} reads {:.1} standard deviations {} than predicted on average; ",
            self.name,
            bias.abs(),
            if bias > 0.0 { "more" } else { "less" }
        )
    }

    /// Whether more than [`CONTRADICTING`] of so many samples are flagged.
    pub(super) fn is_flagged(&self, samples: u64) -> bool {
        self.flags.values().sum::<u64>() as f64 > CONTRADICTING * samples as f64
    }

    /// The fault that most of its samples have, where that is one of the sensor itself.
    pub(super) fn mostly_faulty(&self) -> Option<Cause> {
        let all = self.compared.max(self.flags.values().sum());
        let itself = [
            Fault::Missing,
            Fault::SaturatedHigh,
            Fault::SaturatedLow,
            Fault::Stuck,
            Fault::Dead,
        ];
        let found = itself.into_iter().find(|fault| {
            let count = self.flags.get(fault.name()).copied().unwrap_or(0);
            count as f64 > MOSTLY * all as f64
        })?;
        Some(Cause {
            kind: "sensor",
            what: format!("{} is {} in most samples", self.name, found.name()),
            corrected_percent: None,
            remedy: format!("look for {}", found.cause()),
        })
    }
}
