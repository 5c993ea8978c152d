//! What no effect explains, and what it looks like.

use serde::Serialize;

use super::design::Table;
use super::motion::Motion;

/// Intervals of a variable over which a mean is taken.
const BINS: usize = 24;

/// Correlation of neighbours above which a remainder has structure.
const CORRELATED: f64 = 0.5;

/// What is left of the drive in the recordings that were fitted.
#[derive(Debug, Serialize)]
pub struct Remainder {
    /// Its RMS [% of the drive's].
    pub percent: f64,
    /// Correlation of one judged value with the next; 0 for noise.
    pub neighbours: f64,
    /// For each variable, the part of the remainder's variance that is a function of it.
    pub function_of: Vec<(&'static str, f64)>,
}

impl Remainder {
    /// Describes `rest`.
    pub(super) fn new(motions: &[Motion], table: &Table, rest: &[f64]) -> Self {
        let power: f64 = rest.iter().map(|r| r * r).sum();
        let drive: f64 = table.drive.iter().map(|d| d * d).sum();
        let pairs: f64 = (1..rest.len())
            .filter(|&i| table.recording[i] == table.recording[i - 1])
            .map(|i| rest[i] * rest[i - 1])
            .sum();
        let variable = |of: fn(&Motion) -> &Vec<f64>| -> f64 {
            let values: Vec<f64> = motions.iter().flat_map(|m| m.judged(of(m))).collect();
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
        Self {
            percent: 100.0 * (power / drive).sqrt(),
            neighbours: if power > 0.0 { pairs / power } else { 0.0 },
            function_of,
        }
    }

    /// Whether it is anything but noise.
    pub fn structured(&self) -> bool {
        self.neighbours > CORRELATED || self.function_of.first().is_some_and(|f| f.1 > CORRELATED)
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
    (between / total - BINS as f64 / n).max(0.0)
}
