//! Reads, writes and resamples CSV files of functions over the carrier angle, one column for each
//! channel. Gives sensitivity, maps of candidate nodes and noise of a channel over the angle, in SI
//! units.

use std::io::Write;
use std::path::Path;

use super::MachineError;
use super::error::Violation;
use loadtwin_files::atomic_file::{AtomicFile, Complete, publish};
use loadtwin_files::bounded;
use loadtwin_files::file_kind::FileKind;

/// Entries of a map in the model image.
pub const MAP_ENTRIES: usize = 512;

/// Largest file of maps [bytes]: 10 000 candidate nodes of 180 entries have 30 MB.
const LARGEST_MAP: u64 = 256 << 20;

/// Name of the first column.
const ANGLE: &str = "carrier_angle";

/// What is written as maps over the carrier angle.
pub const MAPS: FileKind = FileKind {
    noun: "maps over the carrier angle",
    suffixes: &["csv"],
    is_same: |file| Ok(file.header().starts_with(ANGLE.as_bytes())),
};

/// Reads column `name` of the map in `path`.
///
/// # Errors
/// As [`read_columns`], and when there is no such column.
pub fn read_column(path: &Path, name: &str) -> Result<Vec<f64>, MachineError> {
    let mut columns = read_columns(path, |title| title == name)?;
    if let Some((_, values)) = columns.pop() {
        return Ok(values);
    }
    let there: Vec<String> = read_columns(path, |_| true)?
        .into_iter()
        .map(|(title, _)| title)
        .collect();
    Err(MachineError::Syntax {
        path: path.to_owned(),
        line: 1,
        column: 1,
        message: format!("no column {name:?}; there are {}", there.join(", ")),
    })
}

/// Reads the columns of the map in `path` whose name is `wanted`: name and values.
///
/// The first column is `carrier_angle [rad]`, in equal steps over one turn
/// from 0, the end of the turn not repeated.
///
/// # Errors
/// When the file cannot be read, or such a column holds anything but finite numbers in equal angular steps; the error names file and line.
pub fn read_columns(
    path: &Path,
    wanted: impl Fn(&str) -> bool,
) -> Result<Vec<(String, Vec<f64>)>, MachineError> {
    let failed = |line: usize, message: String| MachineError::Syntax {
        path: path.to_owned(),
        line,
        column: 1,
        message,
    };
    let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_reader(
        bounded::reader(path, LARGEST_MAP).map_err(|error| failed(1, error.to_string()))?,
    );
    let header = reader
        .headers()
        .map_err(|error| failed(1, error.to_string()))?
        .clone();
    let bare = |title: &str| title.split('[').next().unwrap_or(title).trim().to_owned();
    if header.get(0).is_none_or(|title| bare(title) != ANGLE) {
        return Err(failed(
            1,
            "the first column must be \"carrier_angle [rad]\"".into(),
        ));
    }
    let mut columns: Vec<(usize, String, Vec<f64>)> = header
        .iter()
        .enumerate()
        .skip(1)
        .map(|(i, title)| (i, bare(title)))
        .filter(|(_, name)| wanted(name))
        .map(|(i, name)| (i, name, Vec::new()))
        .collect();
    let mut angles = Vec::new();
    for record in reader.records() {
        let record = record.map_err(|error| failed(angles.len() + 2, error.to_string()))?;
        let line = record
            .position()
            .map_or(0, |position| position.line() as usize);
        let number = |cell: usize| {
            let text = record.get(cell).unwrap_or("").trim();
            match text.parse::<f64>() {
                Ok(value) if value.is_finite() => Ok(value),
                _ => Err(failed(
                    line,
                    format!("found {text:?}, allowed: a finite number"),
                )),
            }
        };
        angles.push(number(0)?);
        for (cell, _, values) in &mut columns {
            values.push(number(*cell)?);
        }
    }
    let step = std::f64::consts::TAU / angles.len().max(1) as f64;
    match angles
        .iter()
        .enumerate()
        .find(|(i, angle)| (*angle - *i as f64 * step).abs() > 0.01 * step)
    {
        _ if angles.len() < 4 => Err(failed(
            1,
            format!("found {} rows, allowed: at least 4", angles.len()),
        )),
        Some((i, angle)) => Err(failed(
            i + 2,
            format!(
                "found angle {angle}, allowed: {} (equal steps over one turn from 0)",
                i as f64 * step
            ),
        )),
        None => Ok(columns
            .into_iter()
            .map(|(_, name, values)| (name, values))
            .collect()),
    }
}

/// Writes functions over the carrier angle as [`complete_columns`], under their name.
///
/// # Errors
/// When the file cannot be written.
pub fn write_columns(path: &Path, columns: &[(String, Vec<f64>)]) -> std::io::Result<()> {
    publish([complete_columns(path, columns)?]).map_err(|error| error.source)
}

/// Writes functions over the carrier angle in equal steps: title `NAME [unit]`
/// and values of each column. The file has no name before it is published.
///
/// # Errors
/// When the file cannot be written.
pub fn complete_columns(path: &Path, columns: &[(String, Vec<f64>)]) -> std::io::Result<Complete> {
    let entries = columns.first().map_or(0, |(_, values)| values.len());
    let mut file = AtomicFile::create(path)?;
    write!(file, "{ANGLE} [rad]")?;
    for (title, _) in columns {
        write!(file, ",{title}")?;
    }
    writeln!(file)?;
    for i in 0..entries {
        write!(
            file,
            "{:.7}",
            std::f64::consts::TAU * i as f64 / entries as f64
        )?;
        for (_, values) in columns {
            write!(file, ",{:e}", six_digits(values[i]))?;
        }
        writeln!(file)?;
    }
    file.complete()
}

/// Six significant digits.
pub fn six_digits(value: f64) -> f64 {
    format!("{value:.5e}").parse().unwrap_or(value)
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
    /// Sensitivity over the carrier angle, in equal steps over a turn (SI).
    ///
    /// # Errors
    /// When the map's file cannot be used, or there is neither map nor constant.
    pub fn sensitivity_over_angle(
        &self,
        machine: &super::Machine,
    ) -> Result<Vec<f64>, MachineError> {
        let Some(file) = &self.sensitivity_map else {
            return Ok(vec![self.sensitivity_si()]);
        };
        let values = read_column(&machine.resolve(file), &self.name)?;
        Ok(values.into_iter().map(|value| self.to_si(value)).collect())
    }

    /// Maps of the candidate nodes of its patch: node and sensitivity over the
    /// carrier angle (SI); none where the channel has no `patch_map`.
    ///
    /// # Errors
    /// When the file cannot be used or has no column for the channel.
    pub fn candidates_over_angle(
        &self,
        machine: &super::Machine,
    ) -> Result<Vec<(String, Vec<f64>)>, MachineError> {
        let Some(file) = &self.patch_map else {
            return Ok(Vec::new());
        };
        let path = machine.resolve(file);
        let node = |name: &str| Some(name.strip_prefix(&self.name)?.strip_prefix('/')?.to_owned());
        let columns = read_columns(&path, |name| node(name).is_some())?;
        if columns.is_empty() {
            return Err(MachineError::Syntax {
                path,
                line: 1,
                column: 1,
                message: format!("no column \"{}/NODE\"", self.name),
            });
        }
        Ok(columns
            .into_iter()
            .filter_map(|(name, values)| {
                let si = values.into_iter().map(|value| self.to_si(value)).collect();
                Some((node(&name)?, si))
            })
            .collect())
    }

    /// Standard deviation of the reading over bins of the carrier angle (SI).
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
