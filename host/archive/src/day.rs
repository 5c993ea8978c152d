//! Defines a row of the table of days (`Day`): verdict, sums over the samples of each load and
//! sensor, the day's recordings, and hashes of what it was made from. Adds the sums of a later
//! recording of the day to those of the earlier ones (`DaySums::add`).

use std::collections::BTreeMap;

use loadtwin_replay::SumsReport;

use crate::verdict::Verdict;

/// How often each fault was flagged.
pub(crate) type Flags = BTreeMap<String, u64>;

/// The days of a machine.
pub(crate) type Days = BTreeMap<String, Day>;

/// A load on a day.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LoadOfDay {
    pub(crate) name: String,
    pub(crate) unit: String,
    /// Samples in which it is valid.
    pub(crate) valid: u64,
    /// Lowest and highest valid value (in `unit`).
    pub(crate) lowest: Option<f32>,
    pub(crate) highest: Option<f32>,
    /// Sum of the valid values (in `unit`).
    pub(crate) sum: f64,
    pub(crate) flags: Flags,
    /// Damage since the first day by the S-N curve of the table of descriptions.
    pub(crate) damage: Option<f64>,
}

/// A sensor on a day.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct SensorOfDay {
    pub(crate) name: String,
    /// Readings that were compared with a prediction.
    pub(crate) compared: u64,
    /// Those of them that contradict the description.
    pub(crate) contradicting: u64,
    /// Readings that were used.
    pub(crate) used: u64,
    /// Innovations over their standard deviation, summed over those used.
    pub(crate) bias: f64,
    /// Normalised innovations squared, summed over those used.
    pub(crate) nis: f64,
    pub(crate) flags: Flags,
}

/// A recording of a day.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct RecordingOfDay {
    pub(crate) name: String,
    pub(crate) samples: u64,
    /// Whether the estimator went on from the recording before, or began anew.
    pub(crate) continued: bool,
    pub(crate) notes: Vec<String>,
    pub(crate) fault: Option<String>,
}

/// Sums of the recordings of a day.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct DaySums {
    pub(crate) samples: u64,
    /// Samples in which some load is valid.
    pub(crate) valid: u64,
    /// Time that the recordings span (s).
    pub(crate) seconds: f64,
    pub(crate) loads: Vec<LoadOfDay>,
    pub(crate) sensors: Vec<SensorOfDay>,
}

/// A day as a row of the table of days.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Day {
    pub(crate) verdict: Verdict,
    pub(crate) sums: DaySums,
    pub(crate) recordings: Vec<RecordingOfDay>,
    pub(crate) fault: Option<String>,
    /// Name of the machine by its description.
    pub(crate) name: Option<String>,
    pub(crate) description: Option<String>,
    pub(crate) description_sha256: Option<String>,
    /// Version of loadtwin that replayed it.
    pub(crate) loadtwin: String,
    /// Hash of all that the day was made from.
    pub(crate) made_from: String,
    /// Hash of the state after it.
    pub(crate) state_sha256: String,
}

impl Day {
    /// Whether the day or one of its recordings has a fault.
    pub(crate) fn has_fault(&self) -> bool {
        self.fault.is_some() || self.recordings.iter().any(|of| of.fault.is_some())
    }

    /// The load that is counted, and its damage.
    pub(crate) fn damage(&self) -> Option<(&str, f64)> {
        let mut loads = self.sums.loads.iter();
        loads.find_map(|load| Some((load.name.as_str(), load.damage?)))
    }
}

fn flags(flags: BTreeMap<&'static str, u64>) -> Flags {
    let flags = flags.into_iter();
    flags
        .map(|(name, count)| (name.to_owned(), count))
        .collect()
}

fn add_flags(total: &mut Flags, flags: Flags) {
    for (name, count) in flags {
        *total.entry(name).or_default() += count;
    }
}

impl From<SumsReport> for DaySums {
    fn from(sums: SumsReport) -> Self {
        let [first_s, last_s] = sums.span_s.unwrap_or_default();
        let loads = sums.loads.into_iter().map(|load| LoadOfDay {
            name: load.name,
            unit: load.unit,
            valid: load.valid,
            lowest: load.lowest,
            highest: load.highest,
            sum: load.sum,
            flags: flags(load.flags),
            damage: None,
        });
        let sensors = sums.sensors.into_iter().map(|sensor| SensorOfDay {
            name: sensor.name,
            compared: sensor.compared,
            contradicting: sensor.contradicting,
            used: sensor.used,
            bias: sensor.bias,
            nis: sensor.nis,
            flags: flags(sensor.flags),
        });
        Self {
            samples: sums.samples,
            valid: sums.valid,
            seconds: last_s - first_s,
            loads: loads.collect(),
            sensors: sensors.collect(),
        }
    }
}

impl DaySums {
    /// Adds the sums of a later recording of the same day: one description holds for a day, so that
    /// loads and sensors are the same in the same order.
    pub(crate) fn add(&mut self, later: Self) {
        if self.loads.is_empty() && self.sensors.is_empty() {
            *self = later;
            return;
        }
        self.samples += later.samples;
        self.valid += later.valid;
        self.seconds += later.seconds;
        for (load, later) in self.loads.iter_mut().zip(later.loads) {
            load.valid += later.valid;
            load.sum += later.sum;
            load.lowest = extreme(load.lowest, later.lowest, f32::min);
            load.highest = extreme(load.highest, later.highest, f32::max);
            add_flags(&mut load.flags, later.flags);
        }
        for (sensor, later) in self.sensors.iter_mut().zip(later.sensors) {
            sensor.compared += later.compared;
            sensor.contradicting += later.contradicting;
            sensor.used += later.used;
            sensor.bias += later.bias;
            sensor.nis += later.nis;
            add_flags(&mut sensor.flags, later.flags);
        }
    }
}

fn extreme(a: Option<f32>, b: Option<f32>, of: fn(f32, f32) -> f32) -> Option<f32> {
    a.zip(b).map(|(a, b)| of(a, b)).or(a).or(b)
}
