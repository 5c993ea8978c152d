//! Which further effects hold on recordings that took no part in the search.

use super::observed::Observed;
use super::refit::{refit, rest};
use super::select::{Found, Selection};

/// Standard deviations that a zero may be off in a recording that took no part in the fit.
const FARTHEST: f64 = 3.0;

impl<S: Observed> Selection<S> {
    /// Keeps of the further effects those that explain recordings which took
    /// no part in the search.
    pub fn confirm(&mut self, sessions: &[S], unseen: &[S]) {
        let mut kept: Vec<Found<S>> = Vec::new();
        let mut left = f64::INFINITY;
        for found in &self.found {
            let mut with = kept.clone();
            with.push(found.clone());
            let size = size(sessions, unseen, &with);
            if kept.is_empty() || !found.effect.lasts() || size < left {
                (kept, left) = (with, size);
            }
        }
        if kept.len() < self.found.len() {
            self.nuisance = refit(sessions, &mut kept, None);
            self.rest = rest(sessions, &kept, &self.nuisance);
            self.found = kept;
        }
    }
}

/// Sum of the logarithms of the mean squares that are left of `unseen`: each stream counts
/// alike, as what a form that is not quite right leaves does not average out.
fn size<S: Observed>(sessions: &[S], unseen: &[S], found: &[Found<S>]) -> f64 {
    let mut found: Vec<Found<S>> = found.iter().filter(|f| f.effect.lasts()).cloned().collect();
    let nuisance = refit(sessions, &mut found, None);
    unseen
        .iter()
        .zip(rest(unseen, &found, &nuisance))
        .flat_map(|(session, rest)| {
            let nuisance = &nuisance;
            rest.into_iter().enumerate().map(move |(k, rest)| {
                let known = rest.iter().filter(|r| r.is_finite());
                let n = known.clone().count().max(1) as f64;
                let mean = known.clone().sum::<f64>() / n;
                let square = known.map(|r| (r - mean).powi(2)).sum::<f64>() / n;
                // Zeros differ from recording to recording, though not without bound.
                let std = session.zero_std(k);
                let fitted = nuisance[k]
                    .first()
                    .filter(|_| std.is_finite())
                    .unwrap_or(&0.0);
                let beyond = ((mean + fitted).abs() - FARTHEST * std).max(0.0);
                (square + beyond * beyond).max(1e-300).ln()
            })
        })
        .sum()
}
