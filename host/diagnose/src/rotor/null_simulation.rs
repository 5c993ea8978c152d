//! Simulates fault-free rotors with parameters within their tolerances, under the recorded motion
//! and the fitted unbalance, and composes null samples from their residuals.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::diagnosis::DiagnoseError;
use crate::null_samples::{NullSamples, resample_blocks};
use crate::residual_model::SignalSet;
use crate::rotor::RotorResiduals;
use crate::rotor::recorded_samples::RotorRecording;
use crate::rotor::uncertain_parameters::UncertainParameter;
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::Machine;
use loadtwin_simulate::{AppliedUnbalance, RotorCourse, RotorScenario, RotorSimulation};

/// Simulations of the machine as described, on what the recording did.
const SIMULATIONS: u64 = 3;

/// Number of null samples of the residuals.
const NULL_SAMPLES: usize = 10;

/// Residuals of fault-free machines for each of `recordings`: `[recording][simulation]`.
///
/// Those of `machine` itself without noise are stored in the signals and subtracted from those of
/// the others, which are within its tolerance.
pub(crate) fn simulated(
    machine: &Machine,
    sensors: &Sensors,
    recordings: &mut [RotorResiduals],
    seed: u64,
) -> Result<Vec<Vec<SignalSet>>, DiagnoseError> {
    let mut all = Vec::new();
    for recording in recordings {
        let mut fault_free = (0..=SIMULATIONS)
            .into_par_iter()
            .map(|k| {
                let seed = seed + k;
                if k == SIMULATIONS {
                    return left(machine, machine, sensors, recording, 0.0, seed);
                }
                left(
                    machine,
                    &indistinguishable_from(machine, seed),
                    sensors,
                    recording,
                    1.0,
                    seed,
                )
            })
            .collect::<Result<Vec<SignalSet>, _>>()?;
        let described = fault_free.pop().unwrap_or_default();
        for indistinguishable_from in &mut fault_free {
            for (of, described) in indistinguishable_from.iter_mut().zip(&described) {
                of.iter_mut()
                    .zip(described)
                    .for_each(|(r, nominal)| *r -= nominal);
            }
        }
        for (signal, fault_free) in recording.residuals.iter_mut().zip(described) {
            signal.fault_free = fault_free;
        }
        all.push(fault_free);
    }
    Ok(all)
}

/// Residuals without effect, each block from one of the simulations.
pub(crate) fn null_samples(
    recordings: &[RotorResiduals],
    fault_free: &[Vec<SignalSet>],
    seed: u64,
) -> NullSamples {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..NULL_SAMPLES)
        .map(|_| {
            (recordings.iter().zip(fault_free))
                .map(|(recording, fault_free)| resample_blocks(recording, fault_free, &mut rng))
                .collect()
        })
        .collect()
}

/// Residuals by `described` of a fault-free simulation of `machine` under the profile of `recording`.
fn left(
    described: &Machine,
    machine: &Machine,
    sensors: &Sensors,
    recording: &RotorResiduals,
    noise: f64,
    seed: u64,
) -> Result<SignalSet, DiagnoseError> {
    let (Some(rotor), Some(real)) = (&described.rotor, &machine.rotor) else {
        return Err(DiagnoseError::NoDrivetrain);
    };
    let turning = recording.turning();
    let scenario = RotorScenario {
        duration_s: turning.angle.len() as f64 * turning.dt_s,
        speeds_rad_s: [rotor.speed_rad_s; 2],
        unbalances: (recording.context.sizes.chunks(2).take(rotor.loads.len()))
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
    let folder = loadtwin_files::scratch::Scratch::new()?;
    let path = folder.path().join("clean.parquet");
    RotorSimulation::along(machine, real, scenario, course)?.write(&path, |_| ())?;
    let recorded = RotorRecording::read(described, rotor, sensors, &path)?;
    let fault_free = RotorResiduals::new(rotor, &sensors.channels, recorded)?;
    Ok(fault_free
        .residuals
        .into_iter()
        .map(|signal| signal.residual)
        .collect())
}

/// A machine that fits the description within what such figures are known to.
fn indistinguishable_from(machine: &Machine, seed: u64) -> Machine {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut machine = machine.clone();
    if let Some(rotor) = &mut machine.rotor {
        for rough in UncertainParameter::all(rotor) {
            rough.scale(rotor, 1.0 + rough.part() * rng.random_range(-1.0..1.0));
        }
    }
    machine
}
