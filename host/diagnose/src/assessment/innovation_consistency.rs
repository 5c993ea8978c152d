//! Runs the described filter with each sensor set on each recording and computes the consistency of
//! its innovations: mean NIS with its 99 % bounds; bias, mean square and whiteness of each sensor.

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::{Serialize, Serializer};

use crate::filter_run::Filtered;
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::Machine;
use loadtwin_math::metrics::{Autocorrelation, NisConsistency};
use loadtwin_replay::ReplayError;

/// Part of the samples for the bounds of the mean NIS.
const PROBABILITY: f64 = 0.99;

/// Consistency of the filter with one set of sensors on one recording.
///
/// Innovations alone mislead: what the estimated load can take up is not in them. A set that is
/// consistent may lack an effect; one that is not lacks something, or is tuned wrongly.
#[derive(Clone, Debug, Serialize)]
pub struct Innovations {
    /// The recording.
    #[serde(serialize_with = "shown")]
    pub recording: PathBuf,
    /// The set of sensors.
    pub sensors: String,
    /// Mean normalised innovation squared of a sample over the number of its sensors; 1 in a
    /// consistent filter.
    pub nis: Option<f64>,
    /// Bounds that this keeps in 99 of 100 recordings where the filter is consistent.
    pub nis_bounds: Option<[f64; 2]>,
    /// Each sensor.
    pub of: Vec<SensorInnovations>,
}

/// The innovations of one sensor, in standard deviations of what the filter expects.
#[derive(Clone, Debug, Serialize)]
pub struct SensorInnovations {
    /// Channel or encoder.
    pub sensor: String,
    /// Mean; 0 in a consistent filter.
    pub bias: Option<f64>,
    /// Mean square; 1 in a consistent filter.
    pub nis: Option<f64>,
    /// Autocorrelation from one sample to the next; 0 where they are white.
    pub next: Option<f64>,
    /// Lags of 1 to 25 samples whose autocorrelation is beyond what 99 % of white sequences have.
    pub coloured_lags: usize,
}

/// A path in JSON, whose texts are Unicode: what is not is replaced.
fn shown<S: Serializer>(path: &Path, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&path.display())
}

/// Runs the filter of `machine` with each of its sets of sensors on each of `recordings`.
///
/// # Errors
/// When the machine or a recording cannot be used.
pub fn innovations(
    machine: &Machine,
    recordings: &[PathBuf],
) -> Result<Vec<Innovations>, ReplayError> {
    let mut sets: Vec<Option<&str>> = (machine.sensor_sets.iter())
        .map(|set| Some(set.name.as_str()))
        .collect();
    if sets.is_empty() {
        sets.push(None);
    }
    let sensors = sets
        .into_iter()
        .map(|set| Sensors::choose(machine, set))
        .collect::<Result<Vec<_>, _>>()?;
    let jobs: Vec<(&PathBuf, &Sensors)> = recordings
        .iter()
        .flat_map(|path| sensors.iter().map(move |sensors| (path, sensors)))
        .collect();
    jobs.into_par_iter()
        .map(|(path, sensors)| of(machine, sensors, path))
        .collect()
}

fn of(machine: &Machine, sensors: &Sensors, path: &Path) -> Result<Innovations, ReplayError> {
    let innovations = Filtered::run(machine, sensors, path)?.innovations;
    let mut all = NisConsistency::default();
    let samples = innovations.iter().map(|(_, of)| of.len()).min();
    for i in 0..samples.unwrap_or(0) {
        let used = innovations
            .iter()
            .map(|(_, of)| of[i])
            .filter(|v| v.is_finite());
        all.push(used.clone().map(|v| v * v).sum(), used.count());
    }
    let expected = all.expected();
    Ok(Innovations {
        recording: path.to_owned(),
        sensors: sensors.name.clone(),
        nis: all.mean().zip(expected).map(|(nis, n)| nis / n),
        nis_bounds: (all.mean_bounds(PROBABILITY).zip(expected))
            .map(|(bounds, n)| bounds.map(|bound| bound / n)),
        of: (innovations.into_iter())
            .filter(|(_, of)| of.iter().any(|v| v.is_finite()))
            .map(|(sensor, of)| SensorInnovations::of(sensor, &of))
            .collect(),
    })
}

impl SensorInnovations {
    fn of(sensor: String, normalised: &[f64]) -> Self {
        let mut sequence = Autocorrelation::default();
        let mut nis = NisConsistency::default();
        for value in normalised {
            sequence.push(*value);
            nis.push(value * value, 1);
        }
        Self {
            sensor,
            bias: sequence.mean(),
            nis: nis.mean(),
            next: sequence.coefficients()[0],
            coloured_lags: sequence.significant_lags().len(),
        }
    }
}
