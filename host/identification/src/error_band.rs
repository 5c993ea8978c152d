//! Measures the error bands of the loads of a drivetrain: runs the estimator with each set of
//! sensors on recordings with reference loads, and scales the stated standard deviation of each
//! load so that twice that contains 95.45 % of its errors. Writes the bands into a description.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rayon::prelude::*;
use toml_edit::{InlineTable, Value};

use loadtwin_common::estimator::Estimator;
use loadtwin_common::io::estimate::Estimate;

use crate::calibrate::Description;
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::{ErrorBand, Machine, six_digits};
use loadtwin_replay::{ReplayError, Sample, run_line};

/// Share of normal errors inside two standard deviations.
const INSIDE: f64 = 0.9545;

/// Shortest time of valid estimates with a reference of which an error band is stated [s]: a
/// hundred windows of the consistency tests.
const LEAST_S: f64 = 10.0;

/// `machine` with the error bands that the last `part` (above 0 to 1) of each of `recordings` shows.
///
/// Of each recording the band is the one by which 95.45 % of the errors are inside two standard
/// deviations; the widest is taken. Loads without a reference, and sets of sensors that the recordings
/// lack, have none: their filter's covariance holds.
#[must_use]
pub fn with_error_bands(machine: &Machine, recordings: &[PathBuf], part: f64) -> Machine {
    let mut changed = machine.clone();
    let Some(drivetrain) = &mut changed.drivetrain else {
        return changed;
    };
    for load in &mut drivetrain.loads {
        load.error_bands.clear();
    }
    let sets = Sensors::set_names(machine);
    let plain = changed.clone();
    let measured: Vec<_> = sets
        .par_iter()
        .map(|set| (*set, bands_of_set(&plain, set, recordings, part)))
        .collect();
    let loads = changed.drivetrain.iter_mut().flat_map(|d| &mut d.loads);
    for (j, load) in loads.enumerate() {
        for (set, bands) in &measured {
            if let Some(Some(band)) = bands.get(j) {
                load.error_bands.insert((*set).to_owned(), *band);
            }
        }
    }
    changed
}

/// The band of each load with one set of sensors: first the deviation that the filter states, then
/// the movement of the loads beside it.
fn bands_of_set(
    machine: &Machine,
    set: &str,
    recordings: &[PathBuf],
    part: f64,
) -> Vec<Option<ErrorBand>> {
    let first = widest(machine, set, recordings, part);
    let mut with = machine.clone();
    let loads = with.drivetrain.iter_mut().flat_map(|d| &mut d.loads);
    for (load, band) in loads.zip(&first) {
        let stated = band.map(|band| ErrorBand {
            error_over_std: 1.0,
            movement: f64::from(f32::MAX),
            ..band
        });
        load.error_bands = stated
            .into_iter()
            .map(|band| (set.to_owned(), band))
            .collect();
    }
    widest(&with, set, recordings, part)
}

/// The widest band of each load among `recordings`.
fn widest(
    machine: &Machine,
    set: &str,
    recordings: &[PathBuf],
    part: f64,
) -> Vec<Option<ErrorBand>> {
    let mut widest = vec![None; machine.loads().len()];
    for recording in recordings {
        // A set that this recording has no columns of is measured on the others.
        let Ok(measured) = measure(machine, set, recording) else {
            continue;
        };
        for (widest, errors) in widest.iter_mut().zip(measured) {
            let band = errors.last(part).band(LEAST_S * machine.rate_hz);
            *widest = match (*widest, band) {
                (Some(a), Some(b)) => Some(larger(a, b)),
                (a, b) => a.or(b),
            };
        }
    }
    widest
}

fn larger(a: ErrorBand, b: ErrorBand) -> ErrorBand {
    ErrorBand {
        error_over_std: a.error_over_std.max(b.error_over_std),
        std_nm: a.std_nm.max(b.std_nm),
        movement: a.movement.max(b.movement),
    }
}

/// The valid estimates of a load that have a reference, in the order of time.
#[derive(Clone, Default)]
struct Errors {
    /// Error over stated standard deviation, positive.
    ratio: Vec<f32>,
    /// Stated standard deviation [N m].
    std: Vec<f32>,
    movement: Vec<f32>,
}

impl Errors {
    fn last(mut self, part: f64) -> Self {
        let first = ((1.0 - part) * self.ratio.len() as f64).round() as usize;
        for values in [&mut self.ratio, &mut self.std, &mut self.movement] {
            values.drain(..first.min(values.len()));
        }
        self
    }

    /// None of fewer than `least` samples.
    fn band(mut self, least: f64) -> Option<ErrorBand> {
        ((self.ratio.len() as f64) >= least).then(|| ErrorBand {
            error_over_std: quantile(&mut self.ratio) / 2.0,
            std_nm: quantile(&mut self.std),
            movement: quantile(&mut self.movement),
        })
    }
}

/// The value that [`INSIDE`] of `values` do not exceed.
fn quantile(values: &mut [f32]) -> f64 {
    let place = (INSIDE * values.len() as f64) as usize;
    let (_, value, _) = values.select_nth_unstable_by(place, f32::total_cmp);
    f64::from(*value)
}

fn measure(machine: &Machine, set: &str, path: &Path) -> Result<Vec<Errors>, ReplayError> {
    let sensors = Sensors::choose(machine, Some(set))?;
    let load_of = machine.load_of_references();
    let mut errors = vec![Errors::default(); machine.loads().len()];
    let each = |sample: &Sample<'_>, estimate: &Estimate, line: &Estimator<'_>, _| {
        for (reference, j) in sample.references.iter().zip(&load_of) {
            let Some(j) = *j else { continue };
            if let (Some(errors), Some(load)) = (errors.get_mut(j), estimate.loads.get(j))
                && load.fault.is_none()
                && reference.is_finite()
            {
                let error = f64::from(load.value) - reference;
                (errors.ratio).push((error.abs() / f64::from(load.std)) as f32);
                errors.std.push(load.std);
                errors.movement.push(line.load_movement(j));
            }
        }
    };
    run_line(machine, &sensors, path, each)?;
    Ok(errors)
}

impl Description {
    /// Writes the error bands of `changed` where they differ from those of `described`.
    pub(crate) fn set_error_bands(&mut self, described: &Machine, changed: &Machine) {
        let [was, is] =
            [described, changed].map(|machine| machine.drivetrain.iter().flat_map(|d| &d.loads));
        for (was, is) in was.zip(is) {
            if is.error_bands.is_empty() {
                self.remove("drivetrain.load", &is.name, "error_bands");
            } else if is.error_bands != was.error_bands {
                let table = table(&is.error_bands);
                self.set("drivetrain.load", &is.name, "error_bands", table);
            }
        }
    }
}

fn table(bands: &BTreeMap<String, ErrorBand>) -> InlineTable {
    let number = |value: f64| Value::from(six_digits(value));
    let fields = |band: &ErrorBand| -> InlineTable {
        let fields = [
            ("error_over_std", number(band.error_over_std)),
            ("std_nm", number(band.std_nm)),
            ("movement", number(band.movement)),
        ];
        fields.into_iter().collect()
    };
    (bands.iter())
        .map(|(set, band)| (set, Value::from(fields(band))))
        .collect()
}
