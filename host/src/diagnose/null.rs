//! What the residuals of the same machine look like without any effect.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::DiagnoseError;
use super::chain::{DAMPING_TOLERANCE, TOLERANCE};
use super::observe::{home, observe_given};
use super::observed::Observed;
use super::stream::Session;
use crate::machine::Machine;
use crate::simulate::{Scenario, Simulation};

/// Simulations of the machine as described, on what the recording did.
const SIMULATIONS: u64 = 3;

/// Draws of the residuals.
const DRAWS: u64 = 10;

/// Residuals without effect: `[draw][session][stream]`, samples as in the session.
pub type Draws = Vec<Vec<Vec<Vec<f64>>>>;

/// Draws residuals without effect: each block from one of a few clean
/// simulations of machines like `machine` doing what it did in each session.
///
/// One more, of the very `machine` without noise, is taken into the streams of
/// `sessions`. What that does not tell of a clean recording, because what was
/// done is only read off it, the draws have as well: each simulation is
/// simulated again from what is read off it, and the difference drawn.
///
/// Where that cannot be simulated, the blocks of the residual itself with
/// signs at random: its size and colour stay, what it has to do with any
/// signal is lost.
pub fn draws(machine: &Machine, sessions: &mut [Session], seed: u64) -> Draws {
    let mut quiet = machine.clone();
    for channel in &mut quiet.channels {
        channel.noise_std = 0.0;
    }
    let clean: Vec<Option<Vec<Session>>> = sessions
        .iter()
        .map(|session| {
            (0..=SIMULATIONS)
                .into_par_iter()
                .map(|k| {
                    let seed = seed + k;
                    if k == SIMULATIONS {
                        return simulated(machine, &quiet, session, seed).ok();
                    }
                    let mut first =
                        simulated(machine, &alike(machine, seed), session, seed).ok()?;
                    let again = simulated(machine, &quiet, &first, seed + SIMULATIONS).ok()?;
                    for (first, again) in first.streams.iter_mut().zip(&again.streams) {
                        for (r, told) in first.residual.iter_mut().zip(&again.residual) {
                            *r -= told;
                        }
                    }
                    home(&mut first.streams, first.signals.count);
                    Some(first)
                })
                .collect()
        })
        .collect();
    for (session, clean) in sessions.iter_mut().zip(&clean) {
        if let Some(last) = clean.as_ref().and_then(|c| c.last()) {
            for (stream, clean) in session.streams.iter_mut().zip(&last.streams) {
                let known = |r: &f64| if r.is_finite() { *r } else { 0.0 };
                stream.clean = clean.residual.iter().map(known).collect();
            }
        }
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..DRAWS)
        .map(|_| {
            sessions
                .iter()
                .zip(&clean)
                .map(|(session, clean)| match clean {
                    Some(clean) => {
                        let alike = &clean[..SIMULATIONS as usize];
                        drawn(session, &residuals(alike), &mut rng)
                    }
                    None => turned(session, &mut rng),
                })
                .collect()
        })
        .collect()
}

fn residuals(clean: &[Session]) -> Vec<Vec<Vec<f64>>> {
    let of = |s: &Session| s.streams.iter().map(|k| k.residual.clone()).collect();
    clean.iter().map(of).collect()
}

/// Each block from one of the simulations, `clean[simulation][stream]`, beside what the model
/// has of a clean machine already.
pub(super) fn drawn<S: Observed>(
    session: &S,
    clean: &[Vec<Vec<f64>>],
    rng: &mut ChaCha8Rng,
) -> Vec<Vec<f64>> {
    let (n, block) = (session.speed().len(), session.block());
    let choice: Vec<usize> = (0..n.div_ceil(block))
        .map(|_| rng.random_range(0..clean.len()))
        .collect();
    (0..session.streams().len())
        .map(|k| {
            let known = session.clean(k);
            (0..n)
                .map(|i| {
                    let drawn = clean[choice[i / block]]
                        .get(k)
                        .and_then(|r| r.get(i).copied());
                    drawn.map_or(f64::NAN, |r| r + known.get(i).copied().unwrap_or(0.0))
                })
                .collect()
        })
        .collect()
}

/// The residual itself, blocks of it turned about their mean.
fn turned(session: &Session, rng: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
    let (n, block) = (session.signals.len(), session.block());
    let choice: Vec<bool> = (0..n.div_ceil(block)).map(|_| rng.random()).collect();
    (session.streams.iter())
        .map(|stream| {
            let mean = mean(&stream.residual);
            let about = |(i, r): (usize, &f64)| {
                if choice[i / block] {
                    r - mean
                } else {
                    mean - r
                }
            };
            stream.residual.iter().enumerate().map(about).collect()
        })
        .collect()
}

fn mean(x: &[f64]) -> f64 {
    let (sum, n) = x
        .iter()
        .filter(|v| v.is_finite())
        .fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
    if n > 0.0 { sum / n } else { 0.0 }
}

/// A machine that fits the description within what such figures are known to.
fn alike(machine: &Machine, seed: u64) -> Machine {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut about = |value: &mut f64, part: f64| *value *= 1.0 + part * rng.random_range(-1.0..1.0);
    let mut machine = machine.clone();
    if let Some(drivetrain) = &mut machine.drivetrain {
        for inertia in &mut drivetrain.inertias {
            about(&mut inertia.moment_kg_m2, TOLERANCE);
        }
        for shaft in &mut drivetrain.shafts {
            about(&mut shaft.stiffness_nm_per_rad, TOLERANCE);
            about(&mut shaft.damping_nm_s_per_rad, DAMPING_TOLERANCE);
        }
    }
    machine
}

/// What `described` makes of a clean simulation of `machine` on what `session` did.
fn simulated(
    described: &Machine,
    machine: &Machine,
    session: &Session,
    seed: u64,
) -> Result<Session, DiagnoseError> {
    let course = session.course.clone().ok_or(DiagnoseError::NoDrivetrain)?;
    let scenario = Scenario::recorded(course);
    let simulation = Simulation::new(machine, &scenario, seed, None, &[])?;
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("clean.parquet");
    simulation.write(&path, |_| ())?;
    let mut clean = observe_given(described, &path, session.told)?;
    // Zeros differ from recording to recording; a block is not to tell from which it is.
    for stream in &mut clean.streams {
        let mean = mean(&stream.residual);
        stream.residual.iter_mut().for_each(|r| *r -= mean);
    }
    Ok(clean)
}
