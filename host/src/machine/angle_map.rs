//! Functions over the carrier angle, one column for each channel, in CSV.

use std::path::Path;

use super::MachineError;
use super::error::Violation;

/// Entries of a map in the model image.
pub const MAP_ENTRIES: usize = 512;

/// Reads column `name` of the map in `path`.
///
/// The first column is `carrier_angle [rad]`, in equal steps over one turn
/// from 0, the end of the turn not repeated.
///
/// # Errors
/// When the file cannot be read, lacks the column, or holds anything but
/// finite numbers in equal angular steps; the error names file and line.
pub fn read_column(path: &Path, name: &str) -> Result<Vec<f64>, MachineError> {
    let failed = |line: usize, message: String| MachineError::Syntax {
        path: path.to_owned(),
        line,
        column: 1,
        message,
    };
    let mut reader = csv::ReaderBuilder::new()
        .comment(Some(b'#'))
        .from_path(path)
        .map_err(|error| failed(1, error.to_string()))?;
    let header = reader
        .headers()
        .map_err(|error| failed(1, error.to_string()))?
        .clone();
    let bare = |title: &str| title.split('[').next().unwrap_or(title).trim().to_owned();
    if header
        .get(0)
        .is_none_or(|title| bare(title) != "carrier_angle")
    {
        return Err(failed(
            1,
            "the first column must be \"carrier_angle [rad]\"".into(),
        ));
    }
    let column = header
        .iter()
        .position(|title| bare(title) == name)
        .ok_or_else(|| {
            let there = header
                .iter()
                .skip(1)
                .map(bare)
                .collect::<Vec<_>>()
                .join(", ");
            failed(1, format!("no column {name:?}; there are {there}"))
        })?;
    let mut values = Vec::new();
    let mut angles = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|error| failed(values.len() + 2, error.to_string()))?;
        let line = record
            .position()
            .map_or(0, |position| position.line() as usize);
        for (cell, store) in [(0, &mut angles), (column, &mut values)] {
            let text = record.get(cell).unwrap_or("").trim();
            match text.parse::<f64>() {
                Ok(value) if value.is_finite() => store.push(value),
                _ => {
                    return Err(failed(
                        line,
                        format!("found {text:?}, allowed: a finite number"),
                    ));
                }
            }
        }
    }
    let step = std::f64::consts::TAU / angles.len().max(1) as f64;
    match angles
        .iter()
        .enumerate()
        .find(|(i, angle)| (*angle - *i as f64 * step).abs() > 0.01 * step)
    {
        _ if values.len() < 4 => Err(failed(
            1,
            format!("found {} rows, allowed: at least 4", values.len()),
        )),
        Some((i, angle)) => Err(failed(
            i + 2,
            format!(
                "found angle {angle}, allowed: {} (equal steps over one turn from 0)",
                i as f64 * step
            ),
        )),
        None => Ok(values),
    }
}

/// A periodic function of `entries` equal steps, by cubic interpolation of `values`.
pub fn resampled(values: &[f64], entries: usize) -> Vec<f64> {
    if values.len() == entries {
        return values.to_vec();
    }
    let n = values.len();
    let at = |i: usize| values[i % n];
    (0..entries)
        .map(|i| {
            let position = i as f64 * n as f64 / entries as f64;
            let (left, u) = (position as usize, position.fract());
            let (p0, p1, p2, p3) = (at(left + n - 1), at(left), at(left + 1), at(left + 2));
            // Catmull-Rom: passes through the values, continuous slope.
            p1 + 0.5
                * u
                * (p2 - p0
                    + u * (2.0 * p0 - 5.0 * p1 + 4.0 * p2 - p3 + u * (3.0 * (p1 - p2) + p3 - p0)))
        })
        .collect()
}

impl super::Channel {
    /// Sensitivity over the carrier angle, in equal steps over a turn [SI].
    ///
    /// # Errors
    /// When the map's file cannot be used, or there is neither map nor constant.
    pub fn sensitivity_over_angle(
        &self,
        machine: &super::Machine,
    ) -> Result<Vec<f64>, MachineError> {
        let values = match (&self.sensitivity_map, self.sensitivity) {
            (Some(file), _) => read_column(&machine.resolve(file), &self.name)?,
            (None, sensitivity) => vec![sensitivity.unwrap_or(1.0)],
        };
        Ok(values.into_iter().map(|value| self.to_si(value)).collect())
    }

    /// Standard deviation of the reading over bins of the carrier angle [SI].
    ///
    /// # Errors
    /// When the map's file cannot be used or holds a value that is not positive.
    pub fn noise_over_angle(&self, machine: &super::Machine) -> Result<Vec<f64>, MachineError> {
        let Some(file) = &self.noise_map else {
            return Ok(vec![self.to_si(self.noise_std)]);
        };
        let path = machine.resolve(file);
        let values = read_column(&path, &self.name)?;
        match values.iter().position(|value| *value <= 0.0) {
            Some(i) => Err(MachineError::violation(
                &path,
                "",
                Violation {
                    field: format!("{} in row {}", self.name, i + 2),
                    found: values[i].to_string(),
                    allowed: "> 0".into(),
                },
            )),
            None => Ok(values.into_iter().map(|value| self.to_si(value)).collect()),
        }
    }
}
