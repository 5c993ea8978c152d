//! Reads a bearing recording with all five loads measured, as raw samples with loads, for
//! calibration and diagnosis. References slower than the gauges are interpolated linearly, over at
//! most 0.25 s.

use std::path::{Path, PathBuf};

use loadtwin_common::bearing::LOADS;
use thiserror::Error;

use crate::{ReplayError, Samples};
use loadtwin_design::bearing::RigSample;
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::{BEARING_LOADS, Machine};

/// Why the loads of a recording are not known.
#[derive(Debug, Error)]
pub enum RecordedError {
    /// The description names no reference of a load.
    #[error("{}: no [[reference]] of load {load}: all five are needed", machine.display())]
    Reference {
        /// The description.
        machine: PathBuf,
        /// The load.
        load: &'static str,
    },
    /// The recording cannot be read.
    #[error(transparent)]
    Replay(#[from] ReplayError),
}

/// Longest time between two readings of a reference that counts as its rate [s]: beyond it, loads between are not known.
const SLOWEST_REFERENCE_S: f64 = 0.25;

/// The samples of `path` with their loads; those of a reference with a lower rate than the gauges are interpolated.
///
/// # Errors
/// [`RecordedError`] when a load has no reference or the recording cannot be read.
pub fn recorded(
    machine: &Machine,
    sensors: &Sensors,
    path: &Path,
) -> Result<Vec<RigSample>, RecordedError> {
    let mut column = [0; LOADS];
    for (column, load) in column.iter_mut().zip(BEARING_LOADS) {
        let found = machine.references.iter().position(|r| r.load == load);
        *column = found.ok_or_else(|| RecordedError::Reference {
            machine: machine.path.clone(),
            load,
        })?;
    }
    let mut samples = Vec::new();
    let mut reader = Samples::open(machine, sensors, path)?;
    while reader.next_block(|sample| {
        samples.push((sample.raw, column.map(|i| sample.references[i])));
    })? {}
    interpolate(
        &mut samples,
        (SLOWEST_REFERENCE_S * machine.rate_hz) as usize,
    );
    Ok(samples)
}

/// Fills rows without a load linearly between the readings before and after, where these are at most `longest` rows apart.
fn interpolate(samples: &mut [RigSample], longest: usize) {
    for load in 0..LOADS {
        let mut last: Option<(usize, f64)> = None;
        for i in 0..samples.len() {
            let read = samples[i].1[load];
            if read.is_nan() {
                continue;
            }
            if let Some((from, before)) = last.filter(|(from, _)| i - from <= longest) {
                for (k, (_, loads)) in samples[from + 1..i].iter_mut().enumerate() {
                    loads[load] = before + (read - before) * (k + 1) as f64 / (i - from) as f64;
                }
            }
            last = Some((i, read));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use loadtwin_common::io::raw::RawSample;

    #[test]
    fn slow_references_are_interpolated_and_long_gaps_stay_unknown() {
        let nan = f64::NAN;
        let mut samples: Vec<RigSample> = [2.0, nan, nan, 5.0, nan, nan, nan, 9.0, nan]
            .map(|load| (RawSample::default(), [load; LOADS]))
            .to_vec();
        interpolate(&mut samples, 3);
        for load in 0..LOADS {
            let found: Vec<f64> = samples.iter().map(|sample| sample.1[load]).collect();
            assert_eq!(found[..4], [2.0, 3.0, 4.0, 5.0]);
            assert!(found[4..7].iter().all(|load| load.is_nan()));
            assert!(found[7].to_bits() == 9.0_f64.to_bits() && found[8].is_nan());
        }
    }
}
