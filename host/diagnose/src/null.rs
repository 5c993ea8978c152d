//! What the residuals of the same machine look like without any effect.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::DiagnoseError;
use super::chain::{DAMPING_TOLERANCE, TOLERANCE};
use super::observe::{home, observe_given};
use super::observed::Observed;
use super::statistics::mean;
use super::stream::Session;
use loadtwin_machine::Machine;
use loadtwin_simulate::{Scenario, Simulation};

/// Simulations of the machine as described, on what the recording did, with other noise.
const SIMULATIONS: u64 = 3;

/// Machines that fit the description within what such figures are known to.
const ALIKE: u64 = 3;

/// Part to which the friction that a description has is known.
const FRICTION_TOLERANCE: f64 = 0.05;

/// Draws of the residuals.
const DRAWS: u64 = 10;

/// Residuals without effect: `[draw][session][stream]`, samples as in the session.
pub type Draws = Vec<Vec<Vec<Vec<f64>>>>;

/// What simulations of one recording without any effect leave, `[simulation][stream]`.
struct Clean {
    /// What noise leaves, and that what was done is only read off the recording.
    noise: Vec<Vec<Vec<f64>>>,
    /// What machines like the one described leave more than that one, without noise.
    alike: Vec<Vec<Vec<f64>>>,
}

/// Draws residuals without effect: of clean simulations of `machine` doing what it did in each
/// session what noise leaves, each block from another one, and over the whole of them what a
/// machine leaves that differs from the description as little as such figures are known.
///
/// What a simulation of the very `machine` without noise leaves is taken into the streams of
/// `sessions`. What that does not tell of a clean recording, because what was
/// done is only read off it, the draws have as well: each simulation with noise is
/// simulated again from what is read off it, and the difference drawn.
///
/// Where that cannot be simulated, the blocks of the residual itself with
/// signs at random: its size and colour stay, what it has to do with any
/// signal is lost.
pub fn draws(machine: &Machine, sessions: &mut [Session], seed: u64) -> Draws {
    let clean: Vec<Option<Clean>> = sessions
        .iter_mut()
        .map(|session| clean(machine, session, seed).ok())
        .collect();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..DRAWS)
        .map(|number| {
            let like = (number % ALIKE) as usize;
            let of = |(session, clean): (&Session, &Option<Clean>)| match clean {
                Some(clean) => {
                    let mut draw = drawn(session, &clean.noise, &mut rng);
                    for (draw, alike) in draw.iter_mut().zip(&clean.alike[like]) {
                        for (value, more) in draw.iter_mut().zip(alike) {
                            *value += more;
                        }
                    }
                    draw
                }
                None => turned(session, &mut rng),
            };
            sessions.iter().zip(&clean).map(of).collect()
        })
        .collect()
}

/// Simulates `machine` doing what it did in `session`, and takes what it leaves without noise
/// into the streams of `session`.
fn clean(machine: &Machine, session: &mut Session, seed: u64) -> Result<Clean, DiagnoseError> {
    let told = &*session;
    let noise = || {
        (0..SIMULATIONS).into_par_iter().map(|k| {
            let first = simulated(machine, machine, told, |s| s, seed + k)?;
            let again = exact(machine, machine, &first, seed)?;
            Ok(beyond(first, &again))
        })
    };
    let alike = || {
        (0..ALIKE)
            .into_par_iter()
            .map(|k| exact(machine, &alike(machine, seed + k), told, seed))
    };
    let (described, (noise, alike)) = rayon::join(
        || exact(machine, machine, told, seed),
        || {
            rayon::join(
                || noise().collect::<Result<Vec<_>, DiagnoseError>>(),
                || alike().collect::<Result<Vec<_>, DiagnoseError>>(),
            )
        },
    );
    let described = described?;
    let alike = alike?.into_iter();
    let alike = alike.map(|alike| beyond(alike, &described)).collect();
    for (stream, clean) in session.streams.iter_mut().zip(described.streams) {
        stream.clean = clean.residual;
    }
    Ok(Clean {
        noise: noise?,
        alike,
    })
}

/// What `session` leaves more than `other`, stream by stream.
fn beyond(mut session: Session, other: &Session) -> Vec<Vec<f64>> {
    for (stream, other) in session.streams.iter_mut().zip(&other.streams) {
        for (r, told) in stream.residual.iter_mut().zip(&other.residual) {
            *r -= told;
        }
    }
    home(&mut session.streams, session.signals.count);
    session.streams.into_iter().map(|s| s.residual).collect()
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
            let mean = mean(stream.residual.iter().copied());
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

/// A machine that fits the description within what such figures are known to.
fn alike(machine: &Machine, seed: u64) -> Machine {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut about = |value: &mut f64, part: f64| *value *= 1.0 + part * rng.random_range(-1.0..1.0);
    let mut machine = machine.clone();
    if let Some(drivetrain) = &mut machine.drivetrain {
        for inertia in &mut drivetrain.inertias {
            about(&mut inertia.moment_kg_m2, TOLERANCE);
            if let Some(friction) = &mut inertia.friction {
                about(&mut friction.coulomb_nm, FRICTION_TOLERANCE);
                about(&mut friction.stribeck_nm, FRICTION_TOLERANCE);
                about(&mut friction.load_part, FRICTION_TOLERANCE);
            }
        }
        for shaft in &mut drivetrain.shafts {
            about(&mut shaft.stiffness_nm_per_rad, TOLERANCE);
            about(&mut shaft.damping_nm_s_per_rad, DAMPING_TOLERANCE);
        }
    }
    machine
}

/// As [`simulated`] by sensors without noise: what stands still repeats its word then and is taken
/// for stuck, but reads what it read before.
fn exact(
    described: &Machine,
    machine: &Machine,
    session: &Session,
    seed: u64,
) -> Result<Session, DiagnoseError> {
    let mut clean = simulated(described, machine, session, Simulation::exact, seed)?;
    for stream in &mut clean.streams {
        let mut last = 0.0;
        for r in &mut stream.residual {
            if r.is_finite() {
                last = *r;
            }
            *r = last;
        }
    }
    Ok(clean)
}

/// What `described` makes of a clean simulation of `machine` on what `session` did, by `sensors`.
fn simulated(
    described: &Machine,
    machine: &Machine,
    session: &Session,
    sensors: impl Fn(Simulation) -> Simulation,
    seed: u64,
) -> Result<Session, DiagnoseError> {
    let course = session.course.clone().ok_or(DiagnoseError::NoDrivetrain)?;
    let scenario = Scenario::recorded(course);
    let simulation = Simulation::new(machine, &scenario, seed, None, &[])?;
    let simulation = sensors(simulation.with_reference_noise(&session.reference_noise));
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("clean.parquet");
    simulation.write(&path, |_| ())?;
    let mut clean = observe_given(described, &path, session.told)?;
    // Zeros differ from recording to recording; a block is not to tell from which it is.
    for stream in &mut clean.streams {
        let mean = mean(stream.residual.iter().copied());
        stream.residual.iter_mut().for_each(|r| *r -= mean);
    }
    Ok(clean)
}
