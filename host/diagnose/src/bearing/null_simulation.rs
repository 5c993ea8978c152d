//! Simulates fault-free bearings of the same description, calibrates each by its own simulated rig,
//! and computes their residuals under the recorded loads and speed: the null samples. Their mean is
//! subtracted from them and from the residuals of the recordings.

use std::path::Path;

use rayon::prelude::*;

use crate::bearing::BearingResiduals;
use crate::diagnosis::DiagnoseError;
use crate::null_samples::NullSamples;
use crate::residual_model::SignalSet;
use loadtwin_design::bearing::{Calibration, Rig, fit};
use loadtwin_replay::recorded;
use loadtwin_simulate::{BearingScenario, BearingSimulation};

/// Bearings that are simulated, each on the rig and in another seat.
const INDIVIDUALS: u64 = 3;

/// For how long each is calibrated [s].
const RIG_S: f64 = 60.0;

/// Null samples of each of `recordings`: residuals of simulated fault-free bearings.
///
/// Others of the same description, calibrated on their own rig, carry the same loads at the
/// same speed: the error of a calibration stays the same for long, so that blocks of different
/// bearings are not mixed.
///
/// # Errors
/// When a bearing as described cannot be simulated or calibrated.
pub(crate) fn null_samples(
    rig: &Rig<'_>,
    recordings: &mut [BearingResiduals],
    seed: u64,
) -> Result<NullSamples, DiagnoseError> {
    let all: Vec<NullSamples> = (0..INDIVIDUALS)
        .into_par_iter()
        .map(|k| {
            let individual = seed + k;
            let calibration = calibrated(rig, individual)?;
            [false, true]
                .into_iter()
                .map(|on_road| {
                    (recordings.iter())
                        .map(|recording| left(rig, &calibration, recording, individual, on_road))
                        .collect()
                })
                .collect()
        })
        .collect::<Result<_, DiagnoseError>>()?;
    let mut null_samples: NullSamples = all.into_iter().flatten().collect();
    for (s, recording) in recordings.iter_mut().enumerate() {
        for (k, signal) in recording.residuals.iter_mut().enumerate() {
            let alike = (0..signal.residual.len())
                .map(|i| {
                    mean(
                        null_samples
                            .iter()
                            .filter_map(|null_sample| null_sample[s][k].get(i).copied()),
                    )
                })
                .collect::<Vec<f64>>();
            let all = (null_samples.iter_mut()).map(|null_sample| &mut null_sample[s][k]);
            for residual in all.chain([&mut signal.residual]) {
                residual
                    .iter_mut()
                    .zip(&alike)
                    .for_each(|(r, alike)| *r -= alike);
            }
        }
    }
    Ok(null_samples)
}

/// Mean of the finite values; 0 where there are none.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let known = values.filter(|v| v.is_finite());
    let (sum, n) = known.fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
    sum / f64::max(n, 1.0)
}

/// The calibration of another bearing of the same description.
fn calibrated(rig: &Rig<'_>, individual: u64) -> Result<Calibration, DiagnoseError> {
    let simulation = BearingSimulation::new(
        rig.machine,
        rig.bearing,
        BearingScenario::Calibration,
        RIG_S,
        individual,
        Some(individual),
        &[],
    )?;
    let samples = written(simulation, |path| {
        Ok(recorded(rig.machine, rig.sensors, path)?)
    })?;
    Ok(fit(rig, &samples)?.0)
}

/// Residuals of another bearing under the operating profile of `recording`.
fn left(
    rig: &Rig<'_>,
    calibration: &Calibration,
    recording: &BearingResiduals,
    individual: u64,
    on_road: bool,
) -> Result<SignalSet, DiagnoseError> {
    let course = recording.context.recorded.course.clone();
    let seed = individual + u64::from(on_road) + INDIVIDUALS;
    let simulation =
        BearingSimulation::along(rig.machine, rig.bearing, course, seed, individual, on_road)?;
    let fault_free = written(simulation, |path| {
        BearingResiduals::read_one(rig, calibration, path)
    })?;
    Ok(fault_free
        .residuals
        .into_iter()
        .map(|signal| signal.residual)
        .collect())
}

/// A simulation as a recording for as long as it is read.
fn written<T>(
    simulation: BearingSimulation,
    read: impl FnOnce(&Path) -> Result<T, DiagnoseError>,
) -> Result<T, DiagnoseError> {
    let folder = loadtwin_files::scratch::Scratch::new()?;
    let path = folder.path().join("clean.parquet");
    simulation
        .write(&path, |_| ())
        .map_err(DiagnoseError::from)?;
    read(&path)
}
