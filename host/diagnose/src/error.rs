//! What the residuals mean for the load: error before and after.

use serde::Serialize;

use super::refit::rest;
use super::select::Found;
use super::stream::{Kind, Session, Told};
use loadtwin_math::metrics::{Stretch, prediction_interval, relative_variance};

/// Blocks that errors are summed over [s].
const BLOCK_S: f64 = 2.0;

/// Stretches of all recordings whose differences say how much an error varies.
const STRETCHES: usize = 16;

/// A figure with the interval in which 95 of 100 are on other recordings as long.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Interval {
    /// Mean absolute error [% of the nominal torque].
    pub value_percent: Option<f64>,
    /// The interval; none where the recordings do not say how much the figure varies.
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
    pub(super) fn as_described(before: &[(f64, f64)], after: &[(f64, f64)]) -> Self {
        let pair = |before, after| Pair {
            before: means(before),
            after: means(after),
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
pub fn load_errors(sessions: &[Session], found: &[Found]) -> LoadErrors {
    let nominal: Vec<Vec<Vec<f64>>> = sessions
        .iter()
        .map(|s| s.streams.iter().map(|k| k.residual.clone()).collect())
        .collect();
    // Nuisances are left as they are.
    let zeros = vec![Vec::new(); sessions[0].streams.len()];
    let with_effects = rest(sessions, found, &zeros);
    let again = |residuals: &[Vec<Vec<f64>>]| recalibrated(sessions, residuals);
    let figure = |residuals: &[Vec<Vec<f64>>]| interval(sessions, residuals);
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

fn interval(sessions: &[Session], residuals: &[Vec<Vec<f64>>]) -> Interval {
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
    means(&blocks)
}

/// Mean of blocks, each by its sum and its count, with the interval in which it is on other
/// recordings as long [%]; none without blocks.
fn means(blocks: &[(f64, f64)]) -> Interval {
    let blocks: Vec<(f64, f64)> = blocks.iter().copied().filter(|b| b.1 > 0.0).collect();
    if blocks.is_empty() {
        return Interval {
            value_percent: None,
            interval_percent: None,
        };
    }
    // Stretches longer than what an error stays alike over.
    let stretches: Vec<Stretch> = blocks
        .chunks(blocks.len().div_ceil(STRETCHES))
        .map(|blocks| Stretch {
            recording: 0,
            error: blocks.iter().map(|b| b.0).sum(),
            size: blocks.iter().map(|b| b.1).sum(),
        })
        .collect();
    let sum = |of: fn(&Stretch) -> f64| stretches.iter().map(of).sum::<f64>();
    let value = 100.0 * sum(|s| s.error) / sum(|s| s.size);
    // A mean square varies twice as much as a mean size, in parts of itself.
    let variance = relative_variance(&stretches).map(|of_size| 4.0 * of_size);
    Interval {
        value_percent: Some(value),
        interval_percent: variance.and_then(|variance| prediction_interval(value, variance)),
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
