//! What the residuals of the same rotor look like without any effect.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::recorded::Recorded;
use super::rough::Rough;
use super::{Readings, RotorSession};
use crate::DiagnoseError;
use crate::null::{Draws, drawn};
use loadtwin_design::build::Sensors;
use loadtwin_machine::Machine;
use loadtwin_simulate::{AppliedUnbalance, RotorCourse, RotorScenario, RotorSimulation};

/// Simulations of the machine as described, on what the recording did.
const SIMULATIONS: u64 = 3;

/// Draws of the residuals.
const DRAWS: usize = 10;

/// What clean machines leave in each of `sessions`: `[session][simulation]`.
///
/// That of the very `machine` without noise is taken into the streams; the others are machines
/// like it, less that.
pub(super) fn simulated(
    machine: &Machine,
    sensors: &Sensors,
    sessions: &mut [RotorSession],
    seed: u64,
) -> Result<Vec<Vec<Readings>>, DiagnoseError> {
    let mut all = Vec::new();
    for session in sessions {
        let mut clean = (0..=SIMULATIONS)
            .into_par_iter()
            .map(|k| {
                let seed = seed + k;
                if k == SIMULATIONS {
                    return left(machine, machine, sensors, session, 0.0, seed);
                }
                left(machine, &alike(machine, seed), sensors, session, 1.0, seed)
            })
            .collect::<Result<Vec<Readings>, _>>()?;
        let described = clean.pop().unwrap_or_default();
        for alike in &mut clean {
            for (of, described) in alike.iter_mut().zip(&described) {
                of.iter_mut()
                    .zip(described)
                    .for_each(|(r, told)| *r -= told);
            }
        }
        for (stream, clean) in session.streams.iter_mut().zip(described) {
            stream.clean = clean;
        }
        all.push(clean);
    }
    Ok(all)
}

/// Residuals without effect, each block from one of the simulations.
pub(super) fn draws(sessions: &[RotorSession], clean: &[Vec<Readings>], seed: u64) -> Draws {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..DRAWS)
        .map(|_| {
            (sessions.iter().zip(clean))
                .map(|(session, clean)| drawn(session, clean, &mut rng))
                .collect()
        })
        .collect()
}

/// What `described` leaves of a clean simulation of `machine` on what `session` did.
fn left(
    described: &Machine,
    machine: &Machine,
    sensors: &Sensors,
    session: &RotorSession,
    noise: f64,
    seed: u64,
) -> Result<Readings, DiagnoseError> {
    let (Some(rotor), Some(real)) = (&described.rotor, &machine.rotor) else {
        return Err(DiagnoseError::NoDrivetrain);
    };
    let turning = session.turning();
    let scenario = RotorScenario {
        duration_s: turning.angle.len() as f64 * turning.dt_s,
        speeds_rad_s: [rotor.speed_rad_s; 2],
        unbalances: (session.seen.sizes.chunks(2).take(rotor.loads.len()))
            .map(|size| AppliedUnbalance {
                moment_kg_m: size[0].hypot(size[1]),
                phase_rad: size[1].atan2(size[0]),
            })
            .collect(),
        noise,
        seed,
    };
    let course = RotorCourse {
        dt_s: turning.dt_s,
        angle: turning.angle.clone(),
        speed: turning.speed.clone(),
    };
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("clean.parquet");
    RotorSimulation::along(machine, real, scenario, course)?.write(&path, |_| ())?;
    let recorded = Recorded::read(described, rotor, sensors, &path)?;
    let clean = RotorSession::new(rotor, &sensors.channels, recorded)?;
    Ok(clean
        .streams
        .into_iter()
        .map(|stream| stream.residual)
        .collect())
}

/// A machine that fits the description within what such figures are known to.
fn alike(machine: &Machine, seed: u64) -> Machine {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut machine = machine.clone();
    if let Some(rotor) = &mut machine.rotor {
        for rough in Rough::all(rotor) {
            rough.scale(rotor, 1.0 + rough.part() * rng.random_range(-1.0..1.0));
        }
    }
    machine
}
