//! Selects the effects that the balance of a drive lacks, stepwise: adds the best significant
//! candidate or pair, refines shapes, eliminates. Also finds the alternatives to each effect, and
//! the experiment that distinguishes them.

use rayon::prelude::*;

use crate::candidate_effect::{EFFECTS, Effect, Scale};
use crate::design_matrix;
use crate::design_matrix::Dataset;
use crate::least_squares::{Columns, Fit, fit, shared};
use crate::significance::{LEAST_GAIN, certain, gain, p_value};
use crate::smoothed_motion::Motion;

/// Part within which two errors count as equal, and the simpler model is taken.
const EQUAL: f64 = 0.01;

/// Probability above which an effect that was added is taken away again. More
/// than [`certain`] asks for, so that nothing comes and goes.
const NO_LONGER_CERTAIN: f64 = 0.2;

/// Columns from which on each column of an effect has its own prior (relevance determination).
const MANY: usize = 8;

/// Rounds of fit and new priors.
const WEIGHINGS: usize = 4;

/// Part by which the error has to fall for two effects that are added together: so
/// many pairs are compared that noise looks like one now and then, but not like a
/// large one.
const LEAST_PAIR_GAIN: f64 = 0.1;

/// Kinds of effect beside which others are tried where none helps alone.
const LOOKED_AHEAD: usize = 6;

/// Shapes of each of those others.
const SHAPES_AHEAD: usize = 3;

/// Relative step of a shape parameter below which its search ends.
pub const FINEST_STEP: f64 = 0.01;

/// Part of the sum of squares by which a step of that search has to lower it.
pub const LEAST_FALL: f64 = 1e-4;

/// Most effects of one machine.
const MOST: usize = 8;

/// Prior deviation of the linear part in parts of the drive's RMS: not bounded in practice.
pub const LINEAR_PRIOR: f64 = 100.0;

/// Prior deviation of an effect in parts of the drive's RMS: no more than about the drive itself.
const EFFECT_PRIOR: f64 = 1.0;

/// An effect with a shape.
#[derive(Clone)]
pub struct Part {
    /// Which.
    pub effect: &'static dyn Effect,
    /// Its shape.
    pub shape: Vec<f64>,
    /// Its columns over the recordings that are fitted.
    pub columns: Vec<Vec<f64>>,
    /// Prior of each column's contribution.
    pub prior: Vec<f64>,
    /// What it adds to the evidence.
    pub evidence: Evidence,
    /// Effects that would do as well in its place, with the error in parts of this one's.
    pub alternatives: Vec<(&'static str, f64)>,
}

impl Part {
    /// Automatic relevance determination: of many columns most contribute nothing,
    /// and what each contributes becomes its prior.
    ///
    /// Source: Tipping 2001, Sparse Bayesian learning.
    fn weigh(&mut self, relevance: &[f64]) {
        if self.columns.len() >= MANY {
            self.prior = relevance.iter().map(|r| r.sqrt()).collect();
        }
    }

    /// This part with the priors that `fit` of it leads to; its columns are the last.
    fn weighed(&self, fit: impl Fn(&Self) -> Fit) -> Self {
        let mut part = self.clone();
        if part.columns.len() >= MANY {
            for _ in 0..WEIGHINGS {
                let fitted = fit(&part);
                part.weigh(&fitted.relevance[fitted.relevance.len() - part.columns.len()..]);
            }
        }
        part
    }
}

/// How sure it is that an effect is there.
#[derive(Clone, Copy, Default)]
pub struct Evidence {
    /// Part by which the error of what was left out falls.
    pub gain: f64,
    /// Probability of that by chance, times the number of candidates.
    pub p_value: f64,
}

/// The recordings that are fitted, and the model so far.
pub struct Selection<'a> {
    motions: &'a [Motion],
    table: &'a Dataset,
    base: Columns,
    /// Variance of the unexplained times its correlation time.
    noise_variance: f64,
    /// What was found.
    pub parts: Vec<Part>,
}

impl<'a> Selection<'a> {
    /// Looks for effects beyond `base`; reports the part done, 0 to 1.
    pub fn find(
        motions: &'a [Motion],
        table: &'a Dataset,
        base: Columns,
        scale: &Scale,
        progress: impl Fn(f64) + Sync,
    ) -> Self {
        let mut selection = Self {
            motions,
            table,
            base,
            noise_variance: 0.0,
            parts: Vec::new(),
        };
        let candidates = candidates(motions, scale);
        let kinds = EFFECTS
            .iter()
            .filter(|e| candidates.iter().any(|c| c.effect.name() == e.name()))
            .count();
        let mut current = selection.fitted_with_noise();
        for step in 0..MOST {
            progress(step as f64 / MOST as f64);
            let names = |parts: &[Part]| parts.iter().map(|p| p.effect.name()).collect::<Vec<_>>();
            let before = names(&selection.parts);
            let Some(parts) = selection.best(&candidates, &current, kinds) else {
                break;
            };
            selection.parts.extend(parts);
            selection.fitted_with_noise();
            selection.rescan(&candidates);
            selection.refine();
            current = selection.fitted_with_noise();
            selection.prune(&mut current, kinds);
            // What was added is what was taken away: it would go round for ever.
            if names(&selection.parts) == before {
                break;
            }
        }
        selection.evaluate(&candidates, kinds);
        selection
    }

    /// The model without the effects found: described, and each recording's own offset.
    pub fn base(&self) -> &Columns {
        &self.base
    }

    /// Variance of what is unexplained times its correlation time in rows.
    pub fn noise_variance(&self) -> f64 {
        self.noise_variance
    }

    /// Columns of the model, without part `without`.
    pub fn columns(&self, without: Option<usize>) -> Columns {
        let mut columns = self.base.clone();
        for (k, part) in self.parts.iter().enumerate() {
            if Some(k) != without {
                columns.push(&part.columns, &part.prior);
            }
        }
        columns
    }

    /// The model fitted.
    pub fn fitted(&self) -> Fit {
        self.fit(&self.columns(None))
    }

    fn fit(&self, columns: &Columns) -> Fit {
        fit(columns, &self.table.drive, self.table, self.noise_variance)
    }

    /// The model fitted, its noise taken from its own residuals.
    fn fitted_with_noise(&mut self) -> Fit {
        for _ in 0..WEIGHINGS {
            let columns = self.columns(None);
            let fitted = self.fit(&columns);
            let mut at = self.base.len();
            for part in &mut self.parts {
                let n = part.columns.len();
                part.weigh(&fitted.relevance[at..at + n]);
                at += n;
            }
            let y = &self.table.drive;
            let explained = columns.times(&fitted.coefficients, y.len());
            let rest: Vec<f64> = y.iter().zip(&explained).map(|(y, e)| y - e).collect();
            let variance = fitted.squares / y.len() as f64;
            self.noise_variance = variance * correlation_rows(&rest, self.table);
        }
        self.fitted()
    }

    /// The candidate that helps most, if one does for certain, or else two.
    fn best(&self, candidates: &[Part], current: &Fit, kinds: usize) -> Option<Vec<Part>> {
        let columns = self.columns(None);
        let mut tried: Vec<Trial> = candidates
            .par_iter()
            .filter(|c| {
                let same = self
                    .parts
                    .iter()
                    .filter(|p| p.effect.name() == c.effect.name());
                same.count() < c.effect.repeats()
            })
            .map(|c| self.tried(&columns, &[], c))
            .collect();
        tried.sort_by(|a, b| a.squares().total_cmp(&b.squares()));
        simplest(
            tried
                .iter()
                .filter(|t| certain(current, &t.fit, kinds, t.is_weighed())),
        )
        .or_else(|| self.best_pair(&columns, &tried, current, kinds))
    }

    /// Two large effects that hide each other help only together: the best few
    /// of `alone`, least error first, and beside each the best of every other kind.
    fn best_pair(
        &self,
        columns: &Columns,
        alone: &[Trial],
        current: &Fit,
        kinds: usize,
    ) -> Option<Vec<Part>> {
        let firsts = best_of_each(alone, 1).into_iter().take(LOOKED_AHEAD);
        let seconds = best_of_each(alone, SHAPES_AHEAD);
        let pairs: Vec<(&Part, &Part)> = firsts
            .flat_map(|first| seconds.iter().map(move |second| (first, *second)))
            .filter(|(first, second)| first.effect.name() != second.effect.name())
            .collect();
        let tried: Vec<Trial> = pairs
            .into_par_iter()
            .map(|(first, second)| {
                let columns = columns.with(&first.columns, &first.prior);
                self.tried(&columns, std::slice::from_ref(first), second)
            })
            .filter(|t| gain(current, &t.fit) >= LEAST_PAIR_GAIN)
            .filter(|t| certain(current, &t.fit, kinds * (kinds - 1) / 2, t.is_weighed()))
            .collect();
        simplest(tried.iter())
    }

    /// Candidate `part` beside `columns`, of which `first` are new, too.
    fn tried(&self, columns: &Columns, first: &[Part], part: &Part) -> Trial {
        let part = part.weighed(|p| self.fit(&columns.with(&p.columns, &p.prior)));
        let fit = self.fit(&columns.with(&part.columns, &part.prior));
        let mut parts = first.to_vec();
        parts.push(part);
        Trial { parts, fit }
    }

    /// Takes the shape on trial that is best now: what was noise beside a missing
    /// effect may be distinguished from it once that is there.
    fn rescan(&mut self, candidates: &[Part]) {
        for k in 0..self.parts.len() {
            let others = self.columns(Some(k));
            let error = |part: &Part| {
                self.fit(&others.with(&part.columns, &part.prior))
                    .left_out_squares()
            };
            let now = error(&self.parts[k]);
            let best = candidates
                .par_iter()
                .filter(|c| c.effect.name() == self.parts[k].effect.name())
                .map(|c| {
                    let c = c.weighed(|part| self.fit(&others.with(&part.columns, &part.prior)));
                    let error = error(&c);
                    (c, error)
                })
                .min_by(|a, b| a.1.total_cmp(&b.1));
            if let Some((part, least)) = best
                && least * (1.0 + EQUAL).powi(2) < now
            {
                self.parts[k] = part;
            }
        }
    }

    /// Moves the shapes to where the fit is best, one at a time, in ever smaller steps.
    fn refine(&mut self) {
        for k in 0..self.parts.len() {
            let others = self.columns(Some(k));
            let prior = self.parts[k].prior.clone();
            let cost = |columns: &[Vec<f64>]| self.fit(&others.with(columns, &prior)).squares;
            let mut part = self.parts[k].clone();
            let mut least = cost(&part.columns);
            for &i in part.effect.refined() {
                let mut step = 0.3;
                while step > FINEST_STEP {
                    let mut moved = false;
                    for factor in [f64::exp(step), f64::exp(-step)] {
                        let mut shape = part.shape.clone();
                        shape[i] *= factor;
                        let columns = design_matrix::columns(self.motions, part.effect, &shape);
                        let found = cost(&columns);
                        if found < least * (1.0 - LEAST_FALL) {
                            least = found;
                            (part.shape, part.columns) = (shape, columns);
                            moved = true;
                            break;
                        }
                    }
                    if !moved {
                        step *= 0.5;
                    }
                }
            }
            self.parts[k] = part;
        }
    }

    /// Takes away what became superfluous or uncertain, the least useful first.
    fn prune(&mut self, current: &mut Fit, kinds: usize) {
        while !self.parts.is_empty() {
            let superfluous = (0..self.parts.len())
                .map(|k| (k, self.fit(&self.columns(Some(k)))))
                .filter(|(_, without)| {
                    gain(without, current) < EQUAL
                        || p_value(without, current) * kinds as f64 > NO_LONGER_CERTAIN
                })
                .min_by(|a, b| a.1.left_out_squares().total_cmp(&b.1.left_out_squares()));
            let Some((k, _)) = superfluous else {
                return;
            };
            self.parts.remove(k);
            *current = self.fitted_with_noise();
        }
    }

    /// Evidence of each part, and what would do in its place.
    fn evaluate(&mut self, candidates: &[Part], kinds: usize) {
        let current = self.fitted();
        for k in 0..self.parts.len() {
            let others = self.columns(Some(k));
            let without = self.fit(&others);
            let name = self.parts[k].effect.name();
            self.parts[k].evidence = Evidence {
                gain: gain(&without, &current),
                p_value: (p_value(&without, &current) * kinds as f64).min(1.0),
            };
            let taken: Vec<&str> = self.parts.iter().map(|p| p.effect.name()).collect();
            let tried: Vec<(&'static str, f64)> = candidates
                .par_iter()
                .filter(|c| c.effect.name() != name && !taken.contains(&c.effect.name()))
                .map(|c| {
                    let c = c.weighed(|part| self.fit(&others.with(&part.columns, &part.prior)));
                    let swapped = self.fit(&others.with(&c.columns, &c.prior));
                    (
                        c.effect.name(),
                        (swapped.left_out_squares() / current.left_out_squares()).sqrt(),
                    )
                })
                .collect();
            let mut best: Vec<(&'static str, f64)> = Vec::new();
            for (name, error) in tried {
                match best.iter_mut().find(|b| b.0 == name) {
                    Some(b) => b.1 = b.1.min(error),
                    None => best.push((name, error)),
                }
            }
            best.retain(|b| b.1 <= 1.0 + LEAST_GAIN);
            best.sort_by(|a, b| a.1.total_cmp(&b.1));
            self.parts[k].alternatives = best;
        }
    }
}

/// New parts, and the model fitted with them.
struct Trial {
    parts: Vec<Part>,
    fit: Fit,
}

impl Trial {
    fn squares(&self) -> f64 {
        self.fit.left_out_squares()
    }

    /// Whether columns were weighed one by one.
    fn is_weighed(&self) -> bool {
        self.parts.iter().any(|p| p.columns.len() >= MANY)
    }

    /// Columns and numbers of shape that are fitted.
    fn size(&self) -> usize {
        let size = |p: &Part| {
            let refined = p.effect.refined().iter().filter(|i| p.shape[**i] != 0.0);
            p.columns.len() + refined.count()
        };
        self.parts.iter().map(size).sum()
    }
}

/// The simplest of those that are as good as the best.
fn simplest<'a>(tried: impl Iterator<Item = &'a Trial> + Clone) -> Option<Vec<Part>> {
    let least = tried.clone().map(Trial::squares).min_by(f64::total_cmp)?;
    tried
        .filter(|t| t.squares() <= least * (1.0 + EQUAL).powi(2))
        .min_by(|a, b| {
            let by_error = a.squares().total_cmp(&b.squares());
            a.size().cmp(&b.size()).then(by_error)
        })
        .map(|t| t.parts.clone())
}

/// The first `count` shapes of each effect in `alone`, in that order.
fn best_of_each(alone: &[Trial], count: usize) -> Vec<&Part> {
    let mut best: Vec<&Part> = Vec::new();
    for part in alone.iter().flat_map(|t| &t.parts) {
        let same = best
            .iter()
            .filter(|b| b.effect.name() == part.effect.name());
        if same.count() < count {
            best.push(part);
        }
    }
    best
}

/// Each effect in each shape on trial.
fn candidates(motions: &[Motion], scale: &Scale) -> Vec<Part> {
    let shapes: Vec<(&'static dyn Effect, Vec<f64>)> = EFFECTS
        .iter()
        .flat_map(|effect| {
            effect
                .shapes(scale)
                .into_iter()
                .map(move |shape| (*effect, shape))
        })
        .collect();
    shapes
        .into_par_iter()
        .map(|(effect, shape)| Part {
            prior: Vec::new(),
            columns: design_matrix::columns(motions, effect, &shape),
            effect,
            shape,
            evidence: Evidence::default(),
            alternatives: Vec::new(),
        })
        .map(|part| Part {
            prior: shared(part.columns.len(), EFFECT_PRIOR),
            ..part
        })
        .collect()
}

/// The experiment that distinguishes an effect from its alternatives.
pub(crate) fn next_experiment(selection: &Selection<'_>) -> Option<String> {
    selection
        .parts
        .iter()
        .find(|part| !part.alternatives.is_empty())
        .map(|part| {
            format!(
                "to tell {} from {}: {}",
                part.effect.name(),
                part.alternatives[0].0,
                part.effect.shown_by()
            )
        })
}

/// Rows over which a residual stays like itself: `1 + 2 sum rho_k`, up to the
/// first that is not positive.
fn correlation_rows(rest: &[f64], table: &Dataset) -> f64 {
    let n = rest.len();
    let power: f64 = rest.iter().map(|r| r * r).sum();
    if power <= 0.0 {
        return 1.0;
    }
    let mut sum = 1.0;
    for lag in 1..n.min(400) {
        let product: f64 = (lag..n)
            .filter(|&i| table.recording[i] == table.recording[i - lag])
            .map(|i| rest[i] * rest[i - lag])
            .sum();
        let rho = product / power;
        if rho <= 0.05 {
            break;
        }
        sum += 2.0 * rho;
    }
    sum
}
