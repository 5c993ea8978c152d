//! What the forms of effects found, which are not quite right, may leave of a residual.

use super::columns::columns;
use super::effect::{Coupling, Effect};
use super::fit::Data;
use super::observed::Observed;
use super::rank::Ranked;
use super::select::{Found, is_latent};
use super::signals::smooth;
use super::trial::Trial;
use super::verdict::ROUGHLY;

/// Times by which what a form leaves of one gauge may be more, as a part, than what it leaves of another.
const UNEVEN: f64 = 3.0;

/// Part of the excess over a clean machine that a candidate leaves at most, which explains
/// what a wrong form leaves only by chance.
const CLEARED: f64 = 0.1;

/// What effects found predict of each stream.
pub(super) struct Forms<'a, S: Observed> {
    data: &'a Data,
    sessions: &'a [S],
    found: &'a [Found<S>],
    /// In which octaves a form that is off may leave something: `[effect][stream]`.
    spectra: Vec<Vec<Vec<f64>>>,
}

impl<'a, S: Observed> Forms<'a, S> {
    /// Of `found` in `sessions`.
    pub fn new(data: &'a Data, sessions: &'a [S], found: &'a [Found<S>]) -> Self {
        let spectra = (found.iter())
            .map(|f| spectra(sessions, f.effect, &f.shape, &f.parameters))
            .map(|of_streams| of_streams.iter().map(|s| distorted(s)).collect())
            .collect();
        Self {
            data,
            sessions,
            found,
            spectra,
        }
    }

    /// `candidate` with the evidence that counts, where it explains more than what forms that
    /// are not quite right leave of the effects found, one that is free to explain anything twice
    /// as much; in squares over what is left in the end.
    ///
    /// A stream in which such a form may be all counts neither for nor against: of any effect
    /// that acts on each stream by itself, and for a candidate that does, of what streams share as
    /// well. One of which next to nothing is left counts whatever the forms.
    pub fn beyond(&self, candidate: &Ranked<S>) -> Option<Ranked<S>> {
        let trial = &candidate.trial;
        let times = if is_latent(self.sessions, candidate.effect) {
            2.0
        } else {
            1.0
        };
        let own = spectra(
            self.sessions,
            candidate.effect,
            &trial.shape,
            &candidate.parameters,
        );
        let alone = candidate.effect.coupling() == Coupling::Own;
        let most = trial.streams.iter().copied().fold(0.0, f64::max);
        let explained: Vec<Vec<f64>> = (trial.streams.iter().enumerate())
            .map(|(k, gain)| self.explained(k, gain.max(0.0)))
            .collect();
        let forms = self.forms(trial, times > 1.0, &explained);
        let (mut score, mut brought, mut before) = (trial.score, 0.0, 0.0);
        for (k, gain) in trial.streams.iter().enumerate() {
            if *gain <= 0.02 * most {
                continue;
            }
            let left = |coupling| times * self.left(coupling, k, &forms, &explained[k], &own[k]);
            let explained = self.data.squares(k, *gain);
            let part = explained / self.data.independent(k);
            let (by_own, by_shared) = (left(Coupling::Own), left(Coupling::Shared));
            let by_itself = by_own + if alone { by_shared } else { 0.0 };
            if clears(trial.excess[k], part) {
                brought += explained;
            } else if explained < by_itself {
                score -= gain;
            } else {
                brought += explained;
                before += by_own + by_shared;
            }
        }
        let mut counted = candidate.clone();
        counted.trial.score = score;
        (brought > before).then_some(counted)
    }

    /// Squares of stream `k` that each of those found explains, over the mean square that is left
    /// beside further evidence `later`.
    fn explained(&self, k: usize, mut later: f64) -> Vec<f64> {
        let mut explained = vec![0.0; self.found.len()];
        for (f, explained) in self.found.iter().zip(&mut explained).rev() {
            let gain = f.streams[k].max(0.0);
            *explained = self.data.squares(k, later + gain) - self.data.squares(k, later);
            later += gain;
        }
        explained
    }

    /// Part, in squares, of what each of those found explains by which its form may be off, where
    /// they explain `explained[stream][effect]` beside `candidate`.
    ///
    /// What acts on each gauge by itself has the same form in all of them, and leaves no more than
    /// what there is beside it: the gauge of which it leaves least, as a part, speaks for the others.
    /// Not so of a signal that is free: it follows the gauge that shows it best. Nor where the
    /// candidate is free, which may take what a form leaves of one gauge only.
    fn forms(&self, candidate: &Trial, is_free: bool, explained: &[Vec<f64>]) -> Vec<f64> {
        let at_most = |i: usize| {
            let parts = explained.iter().zip(&candidate.streams).enumerate();
            let parts = parts.map(|(k, (explained, gain))| {
                let all = self.data.independent(k) + self.data.squares(k, gain.max(0.0));
                all / explained[i]
            });
            UNEVEN * parts.fold(f64::INFINITY, f64::min)
        };
        let form = |(i, f): (usize, &Found<S>)| {
            let form = f.effect.form(&self.sessions[0]).powi(2);
            let same = f.effect.coupling() == Coupling::Own && !is_latent(self.sessions, f.effect);
            if same && !is_free {
                form.min(at_most(i))
            } else {
                form
            }
        };
        self.found.iter().enumerate().map(form).collect()
    }

    /// Squares of stream `k` that those found of that coupling may have left, by their `forms`, of
    /// what they have `explained`, where a candidate has the spectrum `own`.
    fn left(
        &self,
        coupling: Coupling,
        k: usize,
        forms: &[f64],
        explained: &[f64],
        own: &[f64],
    ) -> f64 {
        let of_each = self.found.iter().enumerate();
        of_each
            .filter(|(_, f)| f.effect.coupling() == coupling)
            .map(|(i, _)| forms[i] * overlap(own, &self.spectra[i][k]) * explained[i])
            .sum()
    }
}

/// Part of the excess over a clean machine that `trial` explains, its mean over streams by their
/// evidence; all of it where there is none.
pub(super) fn cleared(data: &Data, trial: &Trial) -> f64 {
    let (mut cleared, mut all) = (0.0, 0.0);
    for (k, gain) in trial.streams.iter().map(|g| g.max(0.0)).enumerate() {
        let excess = trial.excess[k];
        let part = data.squares(k, gain) / data.independent(k);
        let remains = if excess > ROUGHLY {
            left(excess, part).max(0.0) / excess
        } else {
            0.0
        };
        all += gain;
        cleared += gain * (1.0 - remains);
    }
    cleared / all.max(f64::MIN_POSITIVE)
}

/// What is left of an `excess` over the mean square of a clean machine, once `explained` times
/// what is left in the end is explained.
pub(super) fn left(excess: f64, explained: f64) -> f64 {
    (1.0 + excess) / (1.0 + explained) - 1.0
}

/// Whether that is next to nothing.
fn clears(excess: f64, explained: f64) -> bool {
    explained > 0.2 && left(excess, explained) < CLEARED * excess + ROUGHLY
}

/// In which octaves what an effect predicts of each stream lies; empty where it does not act.
fn spectra<S: Observed>(
    sessions: &[S],
    effect: &dyn Effect<S>,
    shape: &[f64],
    parameters: &[Vec<f64>],
) -> Vec<Vec<f64>> {
    let columns = columns(sessions, effect, shape, parameters);
    (parameters.iter().enumerate())
        .map(|(k, parameters)| {
            let mut predicted = Vec::new();
            for (column, value) in columns.iter().zip(parameters) {
                predicted.resize(column[k].len(), 0.0);
                for (p, c) in predicted.iter_mut().zip(&column[k]) {
                    *p += value * c;
                }
            }
            spectrum(predicted)
        })
        .collect()
}

/// Part of the squares of `x` about its mean in each octave, the fastest first.
fn spectrum(mut x: Vec<f64>) -> Vec<f64> {
    let mean = x.iter().sum::<f64>() / x.len().max(1) as f64;
    for x in &mut x {
        *x -= mean;
    }
    let mut octaves = Vec::new();
    let mut width = 3;
    while 4 * width < x.len() {
        let slow = smooth(&x, width);
        octaves.push(
            x.iter()
                .zip(&slow)
                .map(|(x, slow)| (x - slow).powi(2))
                .sum(),
        );
        x = slow;
        width = 2 * width + 1;
    }
    octaves.push(x.iter().map(|x| x * x).sum());
    let total: f64 = octaves.iter().sum();
    let part = |o: f64| o / total.max(1e-300);
    octaves.into_iter().map(part).collect()
}

/// `spectrum` with harmonics up to two octaves faster, which come of a bent form.
fn distorted(spectrum: &[f64]) -> Vec<f64> {
    let slower = |b: usize| spectrum[b..].iter().take(3);
    (0..spectrum.len()).map(|b| slower(b).sum()).collect()
}

/// Most of the squares of something with the spectrum `a` that what has the spectrum `b` can be
/// taken for, whatever its phases.
fn overlap(a: &[f64], b: &[f64]) -> f64 {
    let along: f64 = a.iter().zip(b).map(|(a, b)| (a * b).sqrt()).sum();
    along.min(1.0).powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_is_known_only_roughly() {
        assert!((left(3.0, 1.0) - 1.0).abs() < 1e-12);
        assert!(left(3.0, 3.0).abs() < 1e-12);
        assert!(clears(3.0, 2.2) && !clears(3.0, 1.9));
        assert!(clears(0.46, 0.36) && !clears(0.46, 0.30));
        assert!(!clears(0.1, 0.1));
    }
}
