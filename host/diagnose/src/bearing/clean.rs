//! What other bearings without effect leave when they do the same.

use std::path::Path;

use rayon::prelude::*;

use super::BearingSession;
use crate::DiagnoseError;
use crate::null::Draws;
use crate::taken::Readings;
use loadtwin_design::bearing::{Calibration, Rig, fit};
use loadtwin_replay::recorded;
use loadtwin_simulate::{BearingScenario, BearingSimulation};

/// Bearings that are simulated, each on the rig and in another seat.
const INDIVIDUALS: u64 = 3;

/// For how long each is calibrated [s].
const RIG_S: f64 = 60.0;

/// What clean bearings leave in place of each of `sessions`, each a draw.
///
/// Others of the same description, calibrated on their own rig, carry the same loads at the
/// same speed: what a calibration cannot tell stays the same for long, so that blocks of different
/// bearings are not mixed.
///
/// # Errors
/// When a bearing as described cannot be simulated or calibrated.
pub(super) fn draws(
    rig: &Rig<'_>,
    sessions: &mut [BearingSession],
    seed: u64,
) -> Result<Draws, DiagnoseError> {
    let all: Vec<Draws> = (0..INDIVIDUALS)
        .into_par_iter()
        .map(|k| {
            let individual = seed + k;
            let calibration = calibrated(rig, individual)?;
            [false, true]
                .into_iter()
                .map(|on_road| {
                    (sessions.iter())
                        .map(|session| left(rig, &calibration, session, individual, on_road))
                        .collect()
                })
                .collect()
        })
        .collect::<Result<_, DiagnoseError>>()?;
    let mut draws: Draws = all.into_iter().flatten().collect();
    for (s, session) in sessions.iter_mut().enumerate() {
        for (k, stream) in session.streams.iter_mut().enumerate() {
            let alike = (0..stream.residual.len())
                .map(|i| mean(draws.iter().filter_map(|draw| draw[s][k].get(i).copied())))
                .collect::<Vec<f64>>();
            let all = (draws.iter_mut()).map(|draw| &mut draw[s][k]);
            for residual in all.chain([&mut stream.residual]) {
                residual
                    .iter_mut()
                    .zip(&alike)
                    .for_each(|(r, alike)| *r -= alike);
            }
        }
    }
    Ok(draws)
}

/// Mean of what is finite; 0 where nothing is.
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

/// What is left of another bearing that does what `session` did.
fn left(
    rig: &Rig<'_>,
    calibration: &Calibration,
    session: &BearingSession,
    individual: u64,
    on_road: bool,
) -> Result<Readings, DiagnoseError> {
    let course = session.seen.recorded.course.clone();
    let seed = individual + u64::from(on_road) + INDIVIDUALS;
    let simulation =
        BearingSimulation::along(rig.machine, rig.bearing, course, seed, individual, on_road)?;
    let clean = written(simulation, |path| {
        BearingSession::read_one(rig, calibration, path)
    })?;
    Ok(clean
        .streams
        .into_iter()
        .map(|stream| stream.residual)
        .collect())
}

/// A simulation as a recording for as long as it is read.
fn written<T>(
    simulation: BearingSimulation,
    read: impl FnOnce(&Path) -> Result<T, DiagnoseError>,
) -> Result<T, DiagnoseError> {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("clean.parquet");
    simulation
        .write(&path, |_| ())
        .map_err(DiagnoseError::from)?;
    read(&path)
}
