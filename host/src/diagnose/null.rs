//! What the residuals of the same machine look like without any effect.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::DiagnoseError;
use super::fit::BLOCK_S;
use super::observe::observe;
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
/// simulations of `machine` doing what it did in each session.
///
/// Where that cannot be simulated, the blocks of the residual itself with
/// signs at random: its size and colour stay, what it has to do with any
/// signal is lost.
pub fn draws(machine: &Machine, sessions: &[Session], seed: u64) -> Draws {
    let clean: Vec<Option<Vec<Session>>> = sessions
        .iter()
        .map(|session| {
            (0..SIMULATIONS)
                .map(|k| simulated(machine, session, seed + k).ok())
                .collect()
        })
        .collect();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..DRAWS)
        .map(|_| {
            sessions
                .iter()
                .zip(&clean)
                .map(|(session, clean)| drawn(session, clean.as_deref(), &mut rng))
                .collect()
        })
        .collect()
}

fn drawn(session: &Session, clean: Option<&[Session]>, rng: &mut ChaCha8Rng) -> Vec<Vec<f64>> {
    let n = session.signals.len();
    let length = ((BLOCK_S / session.signals.dt_s) as usize).max(2);
    let blocks = n.div_ceil(length);
    let choice: Vec<usize> = (0..blocks)
        .map(|_| rng.random_range(0..SIMULATIONS as usize))
        .collect();
    session
        .streams
        .iter()
        .enumerate()
        .map(|(k, stream)| {
            let mean = mean(&stream.residual);
            (0..n)
                .map(|i| {
                    let chosen = choice[i / length];
                    match clean {
                        Some(clean) => clean[chosen]
                            .streams
                            .get(k)
                            .and_then(|s| s.residual.get(i).copied())
                            .unwrap_or(f64::NAN),
                        None if chosen.is_multiple_of(2) => stream.residual[i] - mean,
                        None => mean - stream.residual[i],
                    }
                })
                .collect()
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

/// The session of a clean simulation on what `session` did.
fn simulated(machine: &Machine, session: &Session, seed: u64) -> Result<Session, DiagnoseError> {
    let demand = session.demand.iter().copied();
    if session.demand.is_empty() {
        return Err(DiagnoseError::NoDrivetrain);
    }
    let scenario = Scenario::recorded(session.signals.dt_s, demand);
    let simulation = Simulation::new(machine, &scenario, seed, None, &[])?;
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("clean.parquet");
    simulation.write(&path, |_| ())?;
    let mut clean = observe(machine, &path)?;
    // Zeros differ from recording to recording; a block is not to tell from which it is.
    for stream in &mut clean.streams {
        let mean = mean(&stream.residual);
        stream.residual.iter_mut().for_each(|r| *r -= mean);
    }
    Ok(clean)
}
