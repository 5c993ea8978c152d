//! Describes the residual that remains of a drive's balance after the fit: its size (% of the
//! drive's RMS), its autocorrelation, and the part of its variance that position, speed,
//! acceleration, time or load explains. Decides whether an unknown effect acts.

use serde::Serialize;

use crate::design_matrix::Dataset;
use crate::smoothed_motion::Motion;

/// Intervals of a variable over which a mean is taken.
const BINS: usize = 24;

/// Values apart at which a remainder is compared with itself: noise forgets itself
/// within two, as the low-pass leaves `exp(-0.89 k^2)` of it.
const LAGS: std::ops::RangeInclusive<usize> = 3..=8;

/// Correlation at those lags above which a remainder has structure.
const CORRELATED: f64 = 0.3;

/// Standard deviations of chance that it has to be above, too.
const BEYOND_CHANCE: f64 = 4.0;

/// Rows over which the low-pass makes noise like itself: `1 + 2 sum_k exp(-0.89 k^2)`.
const NOISE_ROWS: f64 = 1.9;

/// Part of the variance that a function has to explain for structure.
const FUNCTION: f64 = 0.2;

/// A remainder above this part of the drive [%] that has structure is something unknown.
const UNKNOWN_PERCENT: f64 = 10.0;

/// What is left of the drive in the recordings that were fitted.
#[derive(Debug, Serialize)]
pub struct Remainder {
    /// Its RMS [% of the drive's].
    pub percent: f64,
    /// Correlation of one decimated value with the next; about 0.4 for noise below the cut-off.
    pub neighbours: f64,
    /// Greatest correlation, in size, of decimated values further apart; 0 for noise.
    pub lasting: f64,
    /// Whether it is large, and anything but noise: something unknown acts.
    pub unknown: bool,
    /// For each variable, the part of the remainder's variance that is a function of it.
    pub function_of: Vec<(&'static str, f64)>,
}

impl Remainder {
    /// Describes `rest`.
    pub(crate) fn new(motions: &[Motion], table: &Dataset, rest: &[f64]) -> Self {
        let power: f64 = rest.iter().map(|r| r * r).sum();
        let drive: f64 = table.drive.iter().map(|d| d * d).sum();
        let correlation = |lag: usize| -> f64 {
            let pairs: f64 = (lag..rest.len())
                .filter(|&i| table.recording[i] == table.recording[i - lag])
                .map(|i| rest[i] * rest[i - lag])
                .sum();
            if power > 0.0 { pairs / power } else { 0.0 }
        };
        let variable = |of: fn(&Motion) -> &Vec<f64>| -> f64 {
            let values: Vec<f64> = motions.iter().flat_map(|m| m.decimated(of(m))).collect();
            explained(&values, rest)
        };
        let mut function_of = vec![
            ("position", variable(|m| &m.position)),
            ("speed", variable(|m| &m.speed)),
            ("acceleration", variable(|m| &m.acceleration)),
            ("time", explained(&table.t, rest)),
        ];
        if motions.iter().all(|m| !m.loads.is_empty()) {
            function_of.push(("load", variable(|m| &m.loads[0])));
        }
        function_of.sort_by(|a, b| b.1.total_cmp(&a.1));
        let percent = 100.0 * (power / drive).sqrt();
        let lasting = LAGS
            .map(correlation)
            .max_by(|a, b| a.abs().total_cmp(&b.abs()))
            .unwrap_or(0.0);
        let by_chance = BEYOND_CHANCE * (NOISE_ROWS / rest.len() as f64).sqrt();
        let structured = lasting.abs() > CORRELATED.max(by_chance) || function_of[0].1 > FUNCTION;
        Self {
            percent,
            neighbours: correlation(1),
            lasting,
            unknown: percent > UNKNOWN_PERCENT && structured,
            function_of,
        }
    }
}

/// Part of the variance of `rest` that its mean over intervals of `x` explains,
/// less what chance would.
fn explained(x: &[f64], rest: &[f64]) -> f64 {
    let (least, most) = x
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| {
            (a.min(*x), b.max(*x))
        });
    let n = rest.len() as f64;
    if n <= 2.0 * BINS as f64 || most <= least {
        return 0.0;
    }
    let mut bins = vec![(0.0, 0.0); BINS];
    for (x, r) in x.iter().zip(rest) {
        let k = (((x - least) / (most - least)) * BINS as f64) as usize;
        let bin = &mut bins[k.min(BINS - 1)];
        bin.0 += r;
        bin.1 += 1.0;
    }
    let between: f64 = bins
        .iter()
        .filter(|b| b.1 > 0.0)
        .map(|b| b.0 * b.0 / b.1)
        .sum();
    let total: f64 = rest.iter().map(|r| r * r).sum();
    (between / total - BINS as f64 * NOISE_ROWS / n).max(0.0)
}
