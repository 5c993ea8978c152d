//! What is left of the residuals and is unlike the machine without effect.

use serde::Serialize;

use super::null::Draws;
use super::observed::Observed;
use super::select::Selection;

/// A stream whose rest is larger than that of the machine without effect.
#[derive(Clone, Debug, Serialize)]
pub struct Oddity {
    /// The stream.
    pub channel: String,
    /// Mean square over that of the machine without effect, before and after
    /// what was found.
    pub before: f64,
    /// After what was found.
    pub after: f64,
    /// Part of what is left over that sits in the tenth of the time where
    /// there is most of it; 0.1 where it is everywhere.
    pub concentration: f64,
    /// Middle of that time [s].
    pub at_s: f64,
    /// Frequency around which most of it lies [Hz].
    pub frequency_hz: f64,
    /// The same per turn of the carrier at the mean speed.
    pub order: f64,
}

/// Length of the pieces in which it is told when something happens [s].
const PIECE_S: f64 = 0.5;

/// What is left in each stream, in the order of the streams.
pub fn oddities<S: Observed>(
    sessions: &[S],
    selection: &Selection<S>,
    draws: &Draws,
) -> Vec<Oddity> {
    (0..sessions[0].streams().len())
        .map(|k| {
            let (mut before, mut after, mut clean) = (Vec::new(), Vec::new(), Vec::new());
            for (s, session) in sessions.iter().enumerate() {
                let known = session.residual(k);
                before.extend(known);
                after.extend(&selection.rest[s][k]);
                for draw in draws {
                    clean.extend(
                        draw[s][k]
                            .iter()
                            .zip(known)
                            .filter(|(_, r)| r.is_finite())
                            .map(|(v, _)| *v),
                    );
                }
            }
            let reference = variance(&clean).max(1e-300);
            let dt = sessions[0].dt_s();
            let (concentration, at_s) = concentration(&after, dt);
            let frequency_hz = frequency(&after, dt);
            let speed = sessions[0].speed();
            let speed = speed.iter().map(|w| w.abs()).sum::<f64>() / speed.len() as f64;
            Oddity {
                channel: sessions[0].name(k).to_owned(),
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

/// Variance of what is finite.
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
