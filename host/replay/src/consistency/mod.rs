//! Checks in a replay whether description and recording agree, from sensors, references, index
//! pulses and counters, sample by sample. Names the likely cause of a disagreement and its remedy.
//!
//! Summed up from the innovations of each sensor: the part of its readings beyond three standard
//! deviations. Where that is more than noise makes, causes are tested as hypotheses: the recording
//! is read as each of them says, and the one with the highest likelihood is named if it restores
//! consistency.

mod cause_search;
mod counter_wrap;
mod hypothesis;
mod index_pulses;
mod reference_loads;
mod sensor_consistency;

use std::path::Path;

use loadtwin_common::io::estimate::Estimate;
use serde::Serialize;

use self::counter_wrap::Counter;
use self::index_pulses::IndexPulses;
use self::reference_loads::ReferenceConsistency;
use self::sensor_consistency::contradicts;
pub use self::sensor_consistency::{BIASED, SensorConsistency, SensorSums};
use super::Sample;
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::Machine;

/// NIS of three standard deviations: a consistent filter exceeds it in 0.27 % of the readings.
const BEYOND: f32 = 9.0;

/// Part of the readings beyond it from which description and recording disagree: that of
/// innovations 1.53 times as wide as the filter expects, `2 Q(3 / 1.53)`.
pub const CONTRADICTING: f64 = 0.05;

/// Part of the samples in which some load is valid, below which that is reported.
const VALID: f64 = 0.05;

/// Turns of the carrier without an index pulse from which the pulse is missing.
const TURNS: f64 = 1.5;

/// Readings beyond three standard deviations before the causes are tested: not a start that settles.
pub const SETTLED: u64 = 100;

/// What is likely wrong.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Cause {
    /// `sign`, `unit`, `scale`, `zero`, `swap`, `counts`, `rate`, `index`, `calibration`, `sensor` or
    /// `reference`.
    pub kind: &'static str,
    /// What it is, in words.
    pub what: String,
    /// Readings that contradict the model once that is corrected [%], of the worst sensor;
    /// none where no correction was tested.
    pub corrected_percent: Option<f64>,
    /// What to do.
    pub remedy: String,
}

/// Consistency of one replay, gathered sample by sample.
#[derive(Clone, Debug, Serialize)]
pub struct Consistency {
    /// Each sensor in the order of the estimates.
    pub sensors: Vec<SensorConsistency>,
    /// Samples in which at least one load is valid [%].
    pub valid_percent: Option<f64>,
    /// The likely cause where recording and description disagree.
    pub cause: Option<Cause>,
    #[serde(skip)]
    samples: u64,
    #[serde(skip)]
    valid: u64,
    /// First sample from which the causes can be tested; none where no sensor contradicts so often.
    #[serde(skip)]
    contradicted_at: Option<u64>,
    #[serde(skip)]
    references: Vec<ReferenceConsistency>,
    #[serde(skip)]
    index: Option<IndexPulses>,
    #[serde(skip)]
    counters: Vec<Counter>,
}

impl Consistency {
    /// Nothing gathered yet.
    pub fn new(machine: &Machine, sensors: &Sensors) -> Self {
        Self {
            sensors: SensorConsistency::all(sensors),
            valid_percent: None,
            cause: None,
            samples: 0,
            valid: 0,
            contradicted_at: None,
            references: ReferenceConsistency::all(machine),
            index: IndexPulses::new(machine, sensors),
            counters: sensors.encoders.iter().map(Counter::new).collect(),
        }
    }

    /// Adds one sample.
    pub fn push(&mut self, sample: &Sample<'_>, estimate: &Estimate) {
        self.samples += 1;
        let is_valid = estimate.loads.iter().any(|load| load.fault.is_none());
        self.valid += u64::from(is_valid);
        for (sensor, read) in self.sensors.iter_mut().zip(&estimate.sensors) {
            sensor.push(read);
        }
        let mut most = 0;
        for (reference, value) in self.references.iter_mut().zip(sample.references) {
            reference.push(*value, estimate);
            most = most.max(reference.beyond);
        }
        let sensors = self.sensors.iter().map(SensorConsistency::contradicting);
        if sensors.fold(most, u64::max) >= SETTLED {
            self.contradicted_at.get_or_insert(self.samples);
        }
        if let Some(index) = &mut self.index {
            index.push(sample, estimate);
        }
        for (k, counter) in self.counters.iter_mut().enumerate() {
            counter.push(sample, k);
        }
    }

    /// Sums up, and looks for the cause where recording and description disagree.
    #[must_use]
    pub fn explained(mut self, machine: &Machine, sensors: &Sensors, path: &Path) -> Self {
        for sensor in &mut self.sensors {
            sensor.sum_up();
        }
        self.valid_percent = percent(self.valid, self.samples);
        self.cause = self.cause_in(machine, sensors, path);
        self
    }

    fn cause_in(&self, machine: &Machine, sensors: &Sensors, path: &Path) -> Option<Cause> {
        let by_counter = self.counters.iter().find_map(Counter::cause);
        // Without the encoder's angle no other cause can be tested.
        let by_encoder = || {
            let mut encoders = self.sensors.iter().skip(sensors.channels.len());
            encoders.find_map(SensorConsistency::mostly_faulty)
        };
        let by_index = || self.index.as_ref()?.cause();
        let of_angle = by_counter.or_else(by_encoder).or_else(by_index);
        if of_angle.is_some() {
            return of_angle;
        }
        let contradicted = !self.contradicting().is_empty();
        let by_reference = self.by_reference(machine);
        let mostly_faulty = self
            .sensors
            .iter()
            .find_map(SensorConsistency::mostly_faulty);
        let outside = self.references.iter().any(ReferenceConsistency::is_outside);
        if contradicted || outside || mostly_faulty.is_some() {
            let from = self.contradicted_at;
            let found = cause_search::cause((machine, sensors), path, &self.sensors, from);
            if found.is_some() {
                return found;
            }
        }
        if mostly_faulty.is_some() {
            return mostly_faulty;
        }
        if contradicted {
            return Some(self.unexplained(sensors));
        }
        by_reference.or_else(|| self.never_valid())
    }

    /// The load that is most often outside its band; or biased, where that is by no sensor that is
    /// flagged.
    fn by_reference(&self, machine: &Machine) -> Option<Cause> {
        let flagged = self.sensors.iter().any(|s| s.is_flagged(self.samples));
        let mut worst: Vec<&ReferenceConsistency> = self.references.iter().collect();
        worst.retain(|reference| reference.is_outside() || !flagged);
        worst.sort_by(|a, b| b.part_beyond().total_cmp(&a.part_beyond()));
        worst
            .into_iter()
            .find_map(|reference| reference.cause(machine))
    }

    /// Sensors whose readings contradict the description, the worst first.
    fn contradicting(&self) -> Vec<&SensorConsistency> {
        let mut found: Vec<&SensorConsistency> =
            self.sensors.iter().filter(|s| s.disagrees()).collect();
        found.sort_by(|a, b| b.part_contradicting().total_cmp(&a.part_contradicting()));
        found
    }

    /// The cause where no single correction restores consistency.
    fn unexplained(&self, sensors: &Sensors) -> Cause {
        let channels = self.sensors.iter().take(sensors.channels.len());
        let names: Vec<&str> = channels
            .filter(|s| s.disagrees())
            .map(|s| s.name.as_str())
            .collect();
        let (what, remedy) = if names.is_empty() {
            (
                "the encoders contradict each other or the inertias".to_owned(),
                "check counts_per_turn, speed_ratio, moments of inertia and rate_hz",
            )
        } else {
            (
                format!("zero or sensitivity of {}", names.join(", ")),
                "fit them with `loadtwin calibrate`, or look for an effect with `loadtwin diagnose`",
            )
        };
        Cause {
            kind: "calibration",
            what,
            corrected_percent: None,
            remedy: remedy.into(),
        }
    }

    fn never_valid(&self) -> Option<Cause> {
        let valid = self.valid as f64 / self.samples as f64;
        (valid < VALID).then(|| Cause {
            kind: "sensor",
            what: format!(
                "no load is valid in {:.0} % of the samples",
                100.0 * (1.0 - valid)
            ),
            corrected_percent: None,
            remedy: "see the flags; `loadtwin replay --estimates` has them for each sample".into(),
        })
    }

    /// Recording against description in one line; none where they agree.
    pub fn note(&self) -> Option<String> {
        let cause = self.cause.as_ref()?;
        let worst = self.contradicting();
        let worst = worst.first().map_or_else(String::new, |s| s.disagreement());
        let corrected = cause.corrected_percent.map_or_else(String::new, |percent| {
            format!(" (corrected, {percent:.1} % are)")
        });
        Some(format!(
            "consistency: {worst}likely cause: {}: {}{corrected}; {}",
            cause.kind, cause.what, cause.remedy
        ))
    }
}

fn percent(part: u64, of: u64) -> Option<f64> {
    (of > 0).then(|| 100.0 * part as f64 / of as f64)
}
