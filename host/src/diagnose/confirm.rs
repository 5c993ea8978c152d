//! Which further effects hold on recordings that took no part in the search.

use super::observed::Observed;
use super::refit::{refit, rest};
use super::select::{Found, Selection};

/// Standard deviations that a zero may be off in a recording that took no part in the fit.
const FARTHEST: f64 = 3.0;

/// Part, in squares, of what is left of a stream that an effect must predict there, for that
/// recording to tell whether it is right.
const SHOWN: f64 = 0.05;

impl<S: Observed> Selection<S> {
    /// Keeps of the further effects those that explain recordings which took no part in the
    /// search; one that these do not show stands by what the search found.
    pub fn confirm(&mut self, sessions: &[S], unseen: &[S]) {
        let mut kept: Vec<Found<S>> = Vec::new();
        let mut left = Vec::new();
        for found in &self.found {
            let mut with = kept.clone();
            with.push(found.clone());
            let lasting = Lasting::fitted(sessions, &with);
            let sizes = lasting.sizes(unseen);
            let acting = |k: &usize| !found.parameters[*k].is_empty();
            let sum = |sizes: &[f64]| {
                (0..sizes.len())
                    .filter(acting)
                    .map(|k| sizes[k])
                    .sum::<f64>()
            };
            let accepted = kept.is_empty() || !found.effect.lasts() || sum(&sizes) < sum(&left);
            if accepted || !lasting.shows_the_last(unseen) {
                (kept, left) = (with, sizes);
            }
        }
        if kept.len() < self.found.len() {
            self.nuisance = refit(sessions, &mut kept, None);
            self.rest = rest(sessions, &kept, &self.nuisance);
            self.found = kept;
        }
    }
}

/// Effects that are those of the machine, with nuisances, fitted together.
struct Lasting<S: Observed> {
    found: Vec<Found<S>>,
    nuisance: Vec<Vec<f64>>,
}

impl<S: Observed> Lasting<S> {
    fn fitted(sessions: &[S], found: &[Found<S>]) -> Self {
        let mut found: Vec<Found<S>> = found.iter().filter(|f| f.effect.lasts()).cloned().collect();
        let nuisance = refit(sessions, &mut found, None);
        Self { found, nuisance }
    }

    /// For each stream the sum of the logarithms of the mean squares that are left of `unseen`.
    fn sizes(&self, unseen: &[S]) -> Vec<f64> {
        let mut sizes = vec![0.0; self.nuisance.len()];
        for (session, rest) in (unseen.iter()).zip(rest(unseen, &self.found, &self.nuisance)) {
            for (k, (size, rest)) in sizes.iter_mut().zip(&rest).enumerate() {
                let (mean, square) = moments(rest);
                // Zeros differ from recording to recording, though not without bound.
                let std = session.zero_std(k);
                let fitted = self.nuisance[k]
                    .first()
                    .filter(|_| std.is_finite())
                    .unwrap_or(&0.0);
                let beyond = ((mean + fitted).abs() - FARTHEST * std).max(0.0);
                *size += (square + beyond * beyond).max(1e-300).ln();
            }
        }
        sizes
    }

    /// Whether the last one predicts something of `unseen`.
    fn shows_the_last(&self, unseen: &[S]) -> bool {
        let Some((_, others)) = self.found.split_last() else {
            return false;
        };
        let with = rest(unseen, &self.found, &self.nuisance);
        let without = rest(unseen, others, &self.nuisance);
        (with.iter().flatten().zip(without.iter().flatten())).any(|(with, without)| {
            let predicted: Vec<f64> = without.iter().zip(with).map(|(a, b)| a - b).collect();
            moments(&predicted).1 > SHOWN * moments(with).1
        })
    }
}

/// Mean, and mean square about it, of what is known.
fn moments(values: &[f64]) -> (f64, f64) {
    let known = values.iter().filter(|v| v.is_finite());
    let n = known.clone().count().max(1) as f64;
    let mean = known.clone().sum::<f64>() / n;
    let square = known.map(|v| (v - mean).powi(2)).sum::<f64>() / n;
    (mean, square)
}
