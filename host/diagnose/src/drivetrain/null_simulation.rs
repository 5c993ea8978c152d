//! Simulates a drivetrain without any effect under the recorded operating profile, with noise and
//! with parameters within their tolerances, and composes null samples of the residuals. Where it
//! cannot be simulated, blocks of the residual itself with random signs take their place.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::diagnosis::DiagnoseError;
use crate::drivetrain::chain_response::{damping_std, moment_std, stiffness_std};
use crate::drivetrain::residual_reader::{read_residuals_given, remove_carrier_offset};
use crate::drivetrain::residual_signals::DrivetrainResiduals;
use crate::null_samples::{NullSamples, resample_blocks};
use crate::residual_model::ResidualModel;
use crate::sample_statistics::mean;
use loadtwin_machine::Machine;
use loadtwin_simulate::{Scenario, Simulation};

/// Simulations of the machine as described, on what the recording did, with other noise.
const SIMULATIONS: u64 = 3;

/// Machines drawn within the tolerances of the description.
const ALIKE: u64 = 3;

/// Largest relative deviation of the friction that a description has.
const FRICTION_TOLERANCE: f64 = 0.05;

/// Number of null samples of the residuals.
const NULL_SAMPLES: u64 = 10;

/// Residuals of simulations of one recording without any effect, `[simulation][signal]`.
struct NominalResiduals {
    /// Those of noise, and of the estimation of the operating profile from the recording.
    noise: Vec<Vec<Vec<f64>>>,
    /// Those of machines within the tolerance of the description, without noise, less its own.
    parameter_scatter: Vec<Vec<Vec<f64>>>,
}

/// Null samples of the residuals, from fault-free simulations of `machine` under the profile of each
/// recording: the residuals of noise, each block from another simulation, and over the whole
/// the residuals of a machine that differs from the description within its tolerance.
///
/// The residuals of a simulation of `machine` itself without noise are stored in the signals of
/// `recordings`. That misses a part of a fault-free recording, because the operating profile is
/// only estimated from it; the null samples contain this part as well: each simulation with noise is
/// simulated again from the profile estimated from it, and the difference is the sample.
///
/// Where that cannot be simulated, the blocks of the residual itself with
/// signs at random: its power and colour stay, its correlation with any
/// signal is lost.
pub fn null_samples(
    machine: &Machine,
    recordings: &mut [DrivetrainResiduals],
    seed: u64,
) -> NullSamples {
    let fault_free: Vec<Option<NominalResiduals>> = recordings
        .iter_mut()
        .map(|recording| fault_free(machine, recording, seed).ok())
        .collect();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..NULL_SAMPLES)
        .map(|number| {
            let like = (number % ALIKE) as usize;
            let of =
                |(recording, fault_free): (&DrivetrainResiduals, &Option<NominalResiduals>)| {
                    match fault_free {
                        Some(fault_free) => {
                            let mut null_sample =
                                resample_blocks(recording, &fault_free.noise, &mut rng);
                            for (null_sample, perturbed_machine) in null_sample
                                .iter_mut()
                                .zip(&fault_free.parameter_scatter[like])
                            {
                                for (value, more) in null_sample.iter_mut().zip(perturbed_machine) {
                                    *value += more;
                                }
                            }
                            null_sample
                        }
                        None => sign_flipped_blocks(recording, &mut rng),
                    }
                };
            recordings.iter().zip(&fault_free).map(of).collect()
        })
        .collect()
}

/// Simulates `machine` under the profile of `recording`, and stores its residuals without noise
/// in the signals of `recording`.
fn fault_free(
    machine: &Machine,
    recording: &mut DrivetrainResiduals,
    seed: u64,
) -> Result<NominalResiduals, DiagnoseError> {
    let source = &*recording;
    let noise = || {
        (0..SIMULATIONS).into_par_iter().map(|k| {
            let first = simulated(machine, machine, source, |s| s, seed + k)?;
            let again = noise_free(machine, machine, &first, seed)?;
            Ok(difference(first, &again))
        })
    };
    let perturbed_machine = || {
        (0..ALIKE)
            .into_par_iter()
            .map(|k| noise_free(machine, &perturbed_machine(machine, seed + k), source, seed))
    };
    let (described, (noise, perturbed_machine)) = rayon::join(
        || noise_free(machine, machine, source, seed),
        || {
            rayon::join(
                || noise().collect::<Result<Vec<_>, DiagnoseError>>(),
                || perturbed_machine().collect::<Result<Vec<_>, DiagnoseError>>(),
            )
        },
    );
    let described = described?;
    let perturbed_machine = perturbed_machine?.into_iter();
    let perturbed_machine = perturbed_machine
        .map(|perturbed_machine| difference(perturbed_machine, &described))
        .collect();
    for (signal, fault_free) in recording.residuals.iter_mut().zip(described.residuals) {
        signal.fault_free = fault_free.residual;
    }
    Ok(NominalResiduals {
        noise: noise?,
        parameter_scatter: perturbed_machine,
    })
}

/// Residuals of `recording` less those of `other`, signal by signal.
fn difference(mut recording: DrivetrainResiduals, other: &DrivetrainResiduals) -> Vec<Vec<f64>> {
    for (signal, other) in recording.residuals.iter_mut().zip(&other.residuals) {
        for (r, source) in signal.residual.iter_mut().zip(&other.residual) {
            *r -= source;
        }
    }
    remove_carrier_offset(&mut recording.residuals, recording.signals.count);
    recording
        .residuals
        .into_iter()
        .map(|s| s.residual)
        .collect()
}

/// The residual itself, blocks of it turned about their mean.
fn sign_flipped_blocks(recording: &DrivetrainResiduals, rng: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
    let (n, block) = (recording.signals.len(), recording.block());
    let choice: Vec<bool> = (0..n.div_ceil(block)).map(|_| rng.random()).collect();
    (recording.residuals.iter())
        .map(|signal| {
            let mean = mean(signal.residual.iter().copied());
            let about = |(i, r): (usize, &f64)| {
                if choice[i / block] {
                    r - mean
                } else {
                    mean - r
                }
            };
            signal.residual.iter().enumerate().map(about).collect()
        })
        .collect()
}

/// A machine that fits the description within what such figures are known to.
fn perturbed_machine(machine: &Machine, seed: u64) -> Machine {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut about = |value: &mut f64, part: f64| *value *= 1.0 + part * rng.random_range(-1.0..1.0);
    let mut machine = machine.clone();
    if let Some(drivetrain) = &mut machine.drivetrain {
        for inertia in &mut drivetrain.inertias {
            let std = moment_std(inertia);
            about(&mut inertia.moment_kg_m2, std);
            if let Some(friction) = &mut inertia.friction {
                about(&mut friction.coulomb_nm, FRICTION_TOLERANCE);
                about(&mut friction.stribeck_nm, FRICTION_TOLERANCE);
                about(&mut friction.load_part, FRICTION_TOLERANCE);
            }
        }
        for shaft in &mut drivetrain.shafts {
            let stds = [stiffness_std(shaft), damping_std(shaft)];
            about(&mut shaft.stiffness_nm_per_rad, stds[0]);
            about(&mut shaft.damping_nm_s_per_rad, stds[1]);
        }
    }
    machine
}

/// As [`simulated`] by sensors without noise: a reading at standstill repeats its code and is
/// masked as stuck; it keeps its last value.
fn noise_free(
    described: &Machine,
    machine: &Machine,
    recording: &DrivetrainResiduals,
    seed: u64,
) -> Result<DrivetrainResiduals, DiagnoseError> {
    let mut fault_free = simulated(described, machine, recording, Simulation::exact, seed)?;
    for signal in &mut fault_free.residuals {
        let mut last = 0.0;
        for r in &mut signal.residual {
            if r.is_finite() {
                last = *r;
            }
            *r = last;
        }
    }
    Ok(fault_free)
}

/// Residuals by `described` of a fault-free simulation of `machine` under the profile of `recording`.
fn simulated(
    described: &Machine,
    machine: &Machine,
    recording: &DrivetrainResiduals,
    sensors: impl Fn(Simulation) -> Simulation,
    seed: u64,
) -> Result<DrivetrainResiduals, DiagnoseError> {
    let operating_profile = recording
        .operating_profile
        .clone()
        .ok_or(DiagnoseError::NoDrivetrain)?;
    let scenario = Scenario::recorded(operating_profile);
    let simulation = Simulation::new(machine, &scenario, seed, None, &[])?;
    let simulation = sensors(simulation.with_reference_noise(&recording.reference_noise));
    let folder = loadtwin_files::scratch::Scratch::new()?;
    let path = folder.path().join("clean.parquet");
    simulation.write(&path, |_| ())?;
    let mut fault_free = read_residuals_given(described, &path, recording.torque_source)?;
    // Zeros differ from recording to recording; a block must not reveal its recording.
    for signal in &mut fault_free.residuals {
        let mean = mean(signal.residual.iter().copied());
        signal.residual.iter_mut().for_each(|r| *r -= mean);
    }
    Ok(fault_free)
}
