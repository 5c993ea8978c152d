//! Computes the figures of a replay from samples and estimates: errors of each load against its
//! reference (NMAE, RMSE, bias, coverage of the stated band), NIS and whiteness of the innovations,
//! counts of flagged faults.

use std::collections::BTreeMap;

use loadtwin_common::io::estimate::Estimate;
use serde::Serialize;

use super::{Band, BandFigures, Sample};
use loadtwin_machine::Machine;
use loadtwin_math::metrics::{Autocorrelation, LAGS, LoadError, Segment};

/// Errors, consistency and flags of one replay, gathered sample by sample.
pub struct Figures {
    loads: Vec<(String, f64, LoadError)>,
    /// Sum and sum of squares of each load's estimate, and how many.
    sums: Vec<(f64, f64, u64)>,
    /// For each reference, the load that it measures.
    reference_of: Vec<usize>,
    samples: u64,
    /// Time from which the segments count [s].
    segments_from_s: f64,
    steady: u64,
    nis: (f64, u64),
    /// Of each load.
    bands: Vec<Band>,
    /// Largest error of each load while it is valid [the load's unit].
    largest: Vec<Option<f64>>,
    /// Normalised innovations of each sensor.
    innovations: Vec<Autocorrelation>,
    flags: BTreeMap<&'static str, u64>,
    /// The same of each load alone.
    load_flags: Vec<BTreeMap<&'static str, u64>>,
}

/// One load's errors, in the keys of `--json`.
#[derive(Clone, Debug, Serialize)]
pub struct LoadFigures {
    /// Samples in which it is valid [%].
    pub valid_percent: Option<f64>,
    /// How often each kind of fault was flagged on it.
    pub flags: BTreeMap<&'static str, u64>,
    /// Normalised mean absolute error, full and by segment [% of the nominal load].
    pub nmae_percent: BTreeMap<String, Option<f64>>,
    /// Root mean square error [% of the nominal load].
    pub rmse_percent: Option<f64>,
    /// Root mean square error [the load's unit].
    pub rmse: Option<f64>,
    /// Mean of estimate - reference [% of the nominal load].
    pub bias_percent: Option<f64>,
    /// Largest error of the valid samples, by size [% of the nominal load].
    pub largest_error_percent: Option<f64>,
    /// Valid samples inside the stated band.
    pub band: Option<BandFigures>,
    /// Root mean square of the estimate itself [the load's unit].
    pub rms: Option<f64>,
    /// Mean of the estimate [the load's unit].
    pub mean: Option<f64>,
}

/// Whether the innovations of one sensor are white.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Whiteness {
    /// Autocorrelation from one sample to the next; 0 in a consistent filter.
    pub next: Option<f64>,
    /// Lags of 1 to 25 samples whose autocorrelation is beyond what 99 % of white sequences have [%].
    pub coloured_lags_percent: f64,
}

impl Figures {
    /// Nothing gathered yet.
    pub fn new(machine: &Machine) -> Self {
        let segments = segments(machine);
        let loads: Vec<_> = (machine.loads().iter())
            .map(|load| {
                let error = LoadError::new(segments.clone());
                (load.name.to_owned(), load.nominal, error)
            })
            .collect();
        let reference_of = (machine.load_of_references().into_iter())
            .map(Option::unwrap_or_default)
            .collect();
        Self {
            bands: vec![Band::default(); loads.len()],
            largest: vec![None; loads.len()],
            innovations: Vec::new(),
            sums: vec![(0.0, 0.0, 0); loads.len()],
            load_flags: vec![BTreeMap::new(); loads.len()],
            loads,
            reference_of,
            samples: 0,
            segments_from_s: 0.0,
            steady: 0,
            nis: (0.0, 0),
            flags: BTreeMap::new(),
        }
    }

    /// Adds one sample.
    pub fn push(&mut self, sample: &Sample<'_>, estimate: &Estimate) {
        if self.samples == 0 {
            self.segments_from_s = sample.t - sample.segment_t;
        }
        self.samples += 1;
        self.steady += u64::from(estimate.steady);
        for (reference, j) in sample.references.iter().zip(&self.reference_of) {
            if let (Some((.., error)), Some(load)) =
                (self.loads.get_mut(*j), estimate.loads.get(*j))
                // An estimate that says it knows nothing is no number to be wrong by.
                && load.std < f32::MAX
            {
                error.push(sample.segment_t, f64::from(load.value), *reference);
                if load.fault.is_none()
                    && let (Some(band), Some(largest)) =
                        (self.bands.get_mut(*j), self.largest.get_mut(*j))
                {
                    let error = f64::from(load.value) - reference;
                    band.push(error, f64::from(load.std));
                    if error.is_finite() {
                        *largest = Some(largest.unwrap_or(0.0).max(error.abs()));
                    }
                }
            }
        }
        self.innovations
            .resize_with(estimate.sensors.len(), Autocorrelation::default);
        for (sensor, sequence) in estimate.sensors.iter().zip(&mut self.innovations) {
            let is_used = sensor.fault.is_none() && sensor.innovation_variance > 0.0;
            let sigma = f64::from(sensor.innovation_variance).sqrt();
            sequence.push(if is_used {
                f64::from(sensor.innovation) / sigma
            } else {
                f64::NAN
            });
            if !sensor.fault.is_none() {
                *self.flags.entry(sensor.fault.name()).or_default() += 1;
            } else if sensor.innovation_variance > 0.0 {
                self.nis.0 += f64::from(sensor.nis);
                self.nis.1 += 1;
            }
        }
        for (load, (sum, squares, count)) in estimate.loads.iter().zip(&mut self.sums) {
            if load.std < f32::MAX {
                *sum += f64::from(load.value);
                *squares += f64::from(load.value).powi(2);
                *count += 1;
            }
        }
        for (load, flags) in estimate.loads.iter().zip(&mut self.load_flags) {
            if !load.fault.is_none() {
                *flags.entry(load.fault.name()).or_default() += 1;
                *self.flags.entry(load.fault.name()).or_default() += 1;
            }
        }
    }

    /// Samples so far.
    pub fn samples(&self) -> u64 {
        self.samples
    }

    /// Those of them that were taken by gains computed beforehand.
    pub fn steady_samples(&self) -> u64 {
        self.steady
    }

    /// Mean normalised innovation squared over the used readings of all sensors; 1 in a consistent
    /// filter.
    pub fn nis_mean(&self) -> Option<f64> {
        (self.nis.1 > 0).then(|| self.nis.0 / self.nis.1 as f64)
    }

    /// Whiteness of the innovations of each sensor, in the order of the sensors.
    pub fn whiteness(&self) -> Vec<Whiteness> {
        (self.innovations.iter())
            .map(|sequence| Whiteness {
                next: sequence.coefficients()[0],
                coloured_lags_percent: 100.0 * sequence.significant_lags().len() as f64
                    / LAGS as f64,
            })
            .collect()
    }

    /// Largest autocorrelation of innovations from one sample to the next, by size.
    pub fn largest_next(&self) -> Option<f64> {
        (self.whiteness().iter())
            .filter_map(|of| of.next)
            .max_by(|a, b| a.abs().total_cmp(&b.abs()))
    }

    /// Where the segments do not count in the recording's time, that in one line.
    pub fn segment_note(&self) -> Option<String> {
        let start = Some(self.segments_from_s).filter(|start| *start != 0.0)?;
        Some(format!(
            "segments: the recording begins at t = {start} s, beyond all of them; they count from there"
        ))
    }

    /// How often each kind of fault was flagged, on sensors and loads together.
    pub fn flags(&self) -> &BTreeMap<&'static str, u64> {
        &self.flags
    }

    /// The loads in the order of the machine, with their errors; `None` for
    /// what the recording has no reference for.
    pub fn loads(&self) -> impl Iterator<Item = (&str, LoadFigures)> {
        self.loads
            .iter()
            .enumerate()
            .map(|(j, (name, nominal, error))| {
                let (sum, squares, count) = self.sums[j];
                let mean_of = |sum: f64| (count > 0).then(|| sum / count as f64);
                let known = self.reference_of.contains(&j);
                let percent = |value: Option<f64>| value.filter(|_| known);
                let mut nmae =
                    BTreeMap::from([("full".into(), percent(error.full().nmae_percent(*nominal)))]);
                for (segment, figures) in error.segments() {
                    nmae.insert(segment.into(), percent(figures.nmae_percent(*nominal)));
                }
                let rmse = percent(error.full().rmse());
                let flags = self.load_flags[j].clone();
                let valid = self.samples.saturating_sub(flags.values().sum());
                let figures = LoadFigures {
                    valid_percent: (self.samples > 0)
                        .then(|| 100.0 * valid as f64 / self.samples as f64),
                    flags,
                    nmae_percent: nmae,
                    rmse_percent: rmse.map(|rmse| 100.0 * rmse / nominal),
                    rmse,
                    bias_percent: percent(error.full().bias()).map(|bias| 100.0 * bias / nominal),
                    largest_error_percent: percent(self.largest[j])
                        .map(|largest| 100.0 * largest / nominal),
                    band: (self.bands.get(j))
                        .filter(|_| known)
                        .and_then(Band::figures),
                    rms: mean_of(squares).map(f64::sqrt),
                    mean: mean_of(sum),
                };
                (name.as_str(), figures)
            })
    }
}

/// The parts of a recording that figures are reported for.
pub(super) fn segments(machine: &Machine) -> Vec<Segment> {
    machine
        .segments
        .iter()
        .map(|s| Segment {
            name: s.name.clone(),
            from_s: s.from_s,
            to_s: s.to_s.unwrap_or(f64::INFINITY),
        })
        .collect()
}
