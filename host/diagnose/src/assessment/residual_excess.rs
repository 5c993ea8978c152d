//! Computes for each residual its variance before and after the effects found, over that of the
//! null samples, and where the remaining residual lies: its concentration in time, the time of its
//! largest half second (s), its root mean square frequency (Hz), and that as an order of the main
//! shaft.

use serde::Serialize;

use crate::null_samples::NullSamples;
use crate::residual_model::ResidualModel;
use crate::selection::stepwise::Selection;

/// Excess of one residual signal over the null samples.
#[derive(Clone, Debug, Serialize)]
pub struct ResidualExcess {
    /// The signal.
    pub channel: String,
    /// Variance of the residual over that of the null samples, before the effects found.
    pub before: f64,
    /// The same after the effects found.
    pub after: f64,
    /// Part of the squares of the remaining residual in the tenth of the time where it is largest;
    /// 0.1 for one spread evenly.
    pub concentration: f64,
    /// Middle of the half second in which it is largest, from the start of the first recording (s).
    pub at_s: f64,
    /// Its root mean square frequency (Hz).
    pub frequency_hz: f64,
    /// The same per turn of the main shaft at the mean speed of the first recording.
    pub order: f64,
}

/// Resolution of the time at which an excess lies [s].
const PIECE_S: f64 = 0.5;

/// The excess of each signal, in their order.
pub fn residual_excesses<S: ResidualModel>(
    recordings: &[S],
    selection: &Selection<S>,
    null_samples: &NullSamples,
) -> Vec<ResidualExcess> {
    (0..recordings[0].residuals().len())
        .map(|k| {
            let (mut before, mut after, mut fault_free) = (Vec::new(), Vec::new(), Vec::new());
            for (s, recording) in recordings.iter().enumerate() {
                let known = recording.residual(k);
                before.extend(known);
                after.extend(&selection.residuals_after[s][k]);
                for null_sample in null_samples {
                    fault_free.extend(
                        null_sample[s][k]
                            .iter()
                            .zip(known)
                            .filter(|(_, r)| r.is_finite())
                            .map(|(v, _)| *v),
                    );
                }
            }
            let reference = variance(&fault_free).max(1e-300);
            let dt = recordings[0].dt_s();
            let (concentration, at_s) = concentration(&after, dt);
            let frequency_hz = frequency(&after, dt);
            let speed = recordings[0].speed();
            let speed = speed.iter().map(|w| w.abs()).sum::<f64>() / speed.len() as f64;
            ResidualExcess {
                channel: recordings[0].name(k).to_owned(),
                before: variance(&before) / reference,
                after: variance(&after) / reference,
                concentration,
                at_s,
                frequency_hz,
                order: std::f64::consts::TAU * frequency_hz / speed.max(1e-9),
            }
        })
        .collect()
}

/// Variance of the finite values.
fn variance(x: &[f64]) -> f64 {
    let (n, sum) = x
        .iter()
        .filter(|v| v.is_finite())
        .fold((0.0, 0.0), |(n, sum), v| (n + 1.0, sum + v));
    let mean = sum / f64::max(n, 1.0);
    x.iter()
        .filter(|v| v.is_finite())
        .map(|v| (v - mean).powi(2))
        .sum::<f64>()
        / f64::max(n, 1.0)
}

fn concentration(x: &[f64], dt_s: f64) -> (f64, f64) {
    let length = ((PIECE_S / dt_s) as usize).max(1);
    let mut pieces: Vec<(f64, usize)> = x
        .chunks(length)
        .enumerate()
        .map(|(i, c)| {
            let sum: f64 = c.iter().filter(|v| v.is_finite()).map(|v| v * v).sum();
            (sum, i)
        })
        .collect();
    let total: f64 = pieces.iter().map(|p| p.0).sum();
    pieces.sort_by(|a, b| b.0.total_cmp(&a.0));
    let most: f64 = pieces[..pieces.len().div_ceil(10)]
        .iter()
        .map(|p| p.0)
        .sum();
    let at = pieces.first().map_or(0.0, |p| (p.1 as f64 + 0.5) * PIECE_S);
    (most / total.max(1e-300), at)
}

/// Rate of change over size: the root mean square frequency.
fn frequency(x: &[f64], dt_s: f64) -> f64 {
    let (mut size, mut change) = (0.0, 0.0);
    for pair in x
        .windows(2)
        .filter(|p| p[0].is_finite() && p[1].is_finite())
    {
        size += pair[0] * pair[0];
        change += (pair[1] - pair[0]).powi(2);
    }
    // A wave of f has |dx| = 2 sin(pi f dt) |x|.
    let ratio = (change / f64::max(size, 1e-300)).sqrt() / 2.0;
    ratio.min(1.0).asin() / (std::f64::consts::PI * dt_s)
}
