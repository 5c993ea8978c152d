//! What the residuals mean for the load: error before and after.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

use super::refit::rest;
use super::select::Found;
use super::stream::{Kind, Session, Told};

/// Blocks of the bootstrap [s].
const BLOCK_S: f64 = 2.0;

/// Resamples of the bootstrap.
const RESAMPLES: usize = 400;

/// A figure with what 95 % of the resampled recordings say.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Interval {
    /// Mean absolute error [% of the nominal torque].
    pub value_percent: Option<f64>,
    /// From 2.5 % to 97.5 % of the resamples.
    pub interval_percent: Option<[f64; 2]>,
}

/// A model without and with the effects found.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Pair {
    /// Without.
    pub before: Interval,
    /// With.
    pub after: Interval,
}

/// Error of the torque that all gauges together say, sample by sample.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct LoadErrors {
    /// Gauges as described.
    pub nominal: Pair,
    /// Zero and gain of each gauge fitted anew.
    pub recalibrated: Pair,
}

impl LoadErrors {
    /// Of blocks without and with what was found, each by its sum and its count, where nothing
    /// is calibrated anew.
    pub(super) fn as_described(before: &[(f64, f64)], after: &[(f64, f64)], seed: u64) -> Self {
        let pair = |before, after| Pair {
            before: means(before, seed),
            after: means(after, seed),
        };
        Self {
            nominal: pair(before, after),
            recalibrated: pair(&[], &[]),
        }
    }
}

/// Errors of `sessions` without and with what was found.
///
/// Sample by sample the torque is that which explains the gauges best:
/// `sum(m r / s^2) / sum(m^2 / s^2)`.
pub fn load_errors(sessions: &[Session], found: &[Found], seed: u64) -> LoadErrors {
    let nominal: Vec<Vec<Vec<f64>>> = sessions
        .iter()
        .map(|s| s.streams.iter().map(|k| k.residual.clone()).collect())
        .collect();
    // Nuisances are left as they are.
    let zeros = vec![Vec::new(); sessions[0].streams.len()];
    let with_effects = rest(sessions, found, &zeros);
    let again = |residuals: &[Vec<Vec<f64>>]| recalibrated(sessions, residuals);
    let figure = |residuals: &[Vec<Vec<f64>>]| interval(sessions, residuals, seed);
    LoadErrors {
        nominal: Pair {
            before: figure(&nominal),
            after: figure(&with_effects),
        },
        recalibrated: Pair {
            before: figure(&again(&nominal)),
            after: figure(&again(&with_effects)),
        },
    }
}

/// Residuals less the best zero and gain of each strain.
fn recalibrated(sessions: &[Session], residuals: &[Vec<Vec<f64>>]) -> Vec<Vec<Vec<f64>>> {
    let mut out = residuals.to_vec();
    for k in 0..sessions[0].streams.len() {
        if sessions[0].streams[k].kind != Kind::Strain {
            continue;
        }
        let mut gram = faer::Mat::<f64>::zeros(2, 2);
        let mut right = faer::Mat::<f64>::zeros(2, 1);
        for (session, residual) in sessions.iter().zip(residuals) {
            let reading = &session.streams[k].reading;
            for (r, x) in residual[k]
                .iter()
                .zip(reading)
                .filter(|(r, _)| r.is_finite())
            {
                let row = [1.0, *x];
                for a in 0..2 {
                    right[(a, 0)] += row[a] * r;
                    for b in 0..2 {
                        gram[(a, b)] += row[a] * row[b];
                    }
                }
            }
        }
        let fit = super::sums::solved(gram, &right, &[0.0, 0.0]);
        for (session, out) in sessions.iter().zip(&mut out) {
            for (r, x) in out[k].iter_mut().zip(&session.streams[k].reading) {
                *r -= fit[(0, 0)] + fit[(1, 0)] * x;
            }
        }
    }
    out
}

fn interval(sessions: &[Session], residuals: &[Vec<Vec<f64>>], seed: u64) -> Interval {
    // Sum and count of each block.
    let mut blocks: Vec<(f64, f64)> = Vec::new();
    for (session, residual) in sessions.iter().zip(residuals) {
        let length = ((BLOCK_S / session.signals.dt_s) as usize).max(1);
        let errors: Vec<f64> = (0..session.signals.len())
            .map(|i| error(session, residual, i))
            .collect();
        for block in errors.chunks(length) {
            let known = block.iter().filter(|e| e.is_finite());
            blocks.push((known.clone().map(|e| e.abs()).sum(), known.count() as f64));
        }
    }
    // What the gauges say is no reference for itself.
    if sessions.iter().any(|s| s.told != Told::References) {
        blocks.clear();
    }
    means(&blocks, seed)
}

/// Mean of blocks, each by its sum and its count, with its interval [%]; none without blocks.
fn means(blocks: &[(f64, f64)], seed: u64) -> Interval {
    let blocks: Vec<(f64, f64)> = blocks.iter().copied().filter(|b| b.1 > 0.0).collect();
    if blocks.is_empty() {
        return Interval {
            value_percent: None,
            interval_percent: None,
        };
    }
    let mean = |of: &mut dyn Iterator<Item = (f64, f64)>| {
        let (sum, n) = of.fold((0.0, 0.0), |(s, n), b| (s + b.0, n + b.1));
        100.0 * sum / n
    };
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut resampled: Vec<f64> = (0..RESAMPLES)
        .map(|_| {
            let mut drawn = (0..blocks.len()).map(|_| blocks[rng.random_range(0..blocks.len())]);
            mean(&mut drawn)
        })
        .collect();
    resampled.sort_by(f64::total_cmp);
    let quantile = |q: f64| resampled[((RESAMPLES - 1) as f64 * q).round() as usize];
    Interval {
        value_percent: Some(mean(&mut blocks.iter().copied())),
        interval_percent: Some([quantile(0.025), quantile(0.975)]),
    }
}

/// Error of sample `i`, part of nominal torque.
fn error(session: &Session, residual: &[Vec<f64>], i: usize) -> f64 {
    let (mut sum, mut weight) = (0.0, 0.0);
    for (stream, residual) in session.streams.iter().zip(residual) {
        if stream.kind == Kind::Strain && stream.shaft.is_some() && residual[i].is_finite() {
            let m = stream.map[i] / stream.noise_std;
            sum += m * residual[i] / stream.noise_std;
            weight += m * m;
        }
    }
    sum / weight / session.signals.nominal_torque
}
