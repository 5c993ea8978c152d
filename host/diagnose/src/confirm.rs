//! Which further effects hold on recordings that took no part in the search.

use super::observed::Observed;
use super::refit::{refit, rest, without};
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

/// Effects that are those of the machine, fitted together with those of the recording alone.
struct Lasting<S: Observed>(Vec<Found<S>>);

impl<S: Observed> Lasting<S> {
    fn fitted(sessions: &[S], found: &[Found<S>]) -> Self {
        let mut found = found.to_vec();
        refit(sessions, &mut found, None);
        found.retain(|f| f.effect.lasts());
        Self(found)
    }

    /// For each stream the sum of the logarithms of the mean squares that are left of `unseen`.
    fn sizes(&self, unseen: &[S]) -> Vec<f64> {
        let mut sizes = vec![0.0; unseen[0].streams().len()];
        for session in unseen {
            let (zeros, left) = left_by(&self.0, session);
            for (k, (size, left)) in sizes.iter_mut().zip(&left).enumerate() {
                // Zeros differ from recording to recording, though not without bound.
                let beyond = (zeros[k].abs() - FARTHEST * session.zero_std(k)).max(0.0);
                *size += (square(left) + beyond * beyond).max(1e-300).ln();
            }
        }
        sizes
    }

    /// Whether the last one predicts something of `unseen`.
    fn shows_the_last(&self, unseen: &[S]) -> bool {
        let Some((_, others)) = self.0.split_last() else {
            return false;
        };
        unseen.iter().any(|session| {
            let one = std::slice::from_ref(session);
            let none = vec![Vec::new(); session.streams().len()];
            let (with, without) = (rest(one, &self.0, &none), rest(one, others, &none));
            let (_, left) = left_by(&self.0, session);
            let streams = with[0].iter().zip(&without[0]).zip(&left);
            streams.into_iter().any(|((with, without), left)| {
                let predicted: Vec<f64> = without.iter().zip(with).map(|(a, b)| a - b).collect();
                square(&predicted) > SHOWN * square(left)
            })
        })
    }
}

/// What `found` leaves of each stream of a recording that took no part in the fit, and its zero;
/// what every recording has of its own (zeros, counts, how it vibrates at first) is fitted anew.
fn left_by<S: Observed>(found: &[Found<S>], session: &S) -> (Vec<f64>, Vec<Vec<f64>>) {
    let none = vec![Vec::new(); session.streams().len()];
    let one = without(std::slice::from_ref(session), found, &none);
    // Taken off already: of these only what goes with them.
    let mut taken_off = found.to_vec();
    for f in &mut taken_off {
        f.parameters.clone_from(&none);
    }
    let nuisance = refit(&one, &mut taken_off, None);
    let zeros = nuisance.iter().map(|n| n.first().copied().unwrap_or(0.0));
    (zeros.collect(), rest(&one, &taken_off, &nuisance).remove(0))
}

/// Mean square, about the mean, of what is known.
fn square(values: &[f64]) -> f64 {
    let known = values.iter().filter(|v| v.is_finite());
    let n = known.clone().count().max(1) as f64;
    let mean = known.clone().sum::<f64>() / n;
    known.map(|v| (v - mean).powi(2)).sum::<f64>() / n
}
