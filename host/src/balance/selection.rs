//! Which effects a balance lacks.

use rayon::prelude::*;

use super::design::{self, Table};
use super::effect::{EFFECTS, Effect, Scale};
use super::fit::{Columns, Fit, fit, shared};
use super::motion::Motion;

/// Part by which the error of what was left out has to fall for an effect to be added.
const LEAST_GAIN: f64 = 0.02;

/// Part within which two errors count as equal, and the simpler model is taken.
const EQUAL: f64 = 0.01;

/// Probability of a false alarm, over all candidates together.
const FALSE_ALARM: f64 = 0.02;

/// Probability above which an effect that was added is taken away again. More
/// than [`FALSE_ALARM`], so that nothing comes and goes.
const NO_LONGER_CERTAIN: f64 = 0.2;

/// Columns from which on an effect's columns are weighed one by one.
const MANY: usize = 8;

/// Rounds of that.
const WEIGHINGS: usize = 4;

/// Most effects of one machine.
const MOST: usize = 8;

/// Contribution of the linear model in parts of the drive's RMS: not bounded in practice.
pub const LINEAR_PRIOR: f64 = 100.0;

/// An effect contributes no more than about the drive itself.
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
    table: &'a Table,
    /// What is to be explained.
    y: &'a [f64],
    base: Columns,
    /// Variance of the unexplained times its correlation time.
    noise_variance: f64,
    /// What was found.
    pub parts: Vec<Part>,
}

impl<'a> Selection<'a> {
    /// Looks for effects beyond `base` that explain `y`; tells the part done, 0 to 1.
    pub fn find(
        motions: &'a [Motion],
        table: &'a Table,
        y: &'a [f64],
        base: Columns,
        scale: &Scale,
        progress: impl Fn(f64) + Sync,
    ) -> Self {
        let mut selection = Self {
            motions,
            table,
            y,
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
            let Some(part) = selection.best(&candidates, &current, kinds) else {
                break;
            };
            selection.parts.push(part);
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
        selection.judge(&candidates, kinds);
        selection
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
        fit(columns, self.y, self.table, self.noise_variance)
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
            let explained = columns.times(&fitted.coefficients, self.y.len());
            let rest: Vec<f64> = self.y.iter().zip(&explained).map(|(y, e)| y - e).collect();
            let variance = fitted.squares / self.y.len() as f64;
            self.noise_variance = variance * correlation_rows(&rest, self.table);
        }
        self.fitted()
    }

    /// The candidate that helps most, if one does for certain.
    fn best(&self, candidates: &[Part], current: &Fit, kinds: usize) -> Option<Part> {
        let columns = self.columns(None);
        let tried: Vec<(Part, Fit)> = candidates
            .par_iter()
            .filter(|c| {
                let same = self
                    .parts
                    .iter()
                    .filter(|p| p.effect.name() == c.effect.name());
                same.count() < c.effect.repeats()
            })
            .map(|c| {
                let c = c.weighed(|part| self.fit(&columns.with(&part.columns, &part.prior)));
                let fit = self.fit(&columns.with(&c.columns, &c.prior));
                (c, fit)
            })
            .filter(|(_, fit)| certain(current, fit, kinds))
            .collect();
        let least = tried
            .iter()
            .map(|(_, f)| f.left_out_squares())
            .min_by(f64::total_cmp)?;
        let (part, _) = tried
            .iter()
            .filter(|(_, f)| f.left_out_squares() <= least * (1.0 + EQUAL).powi(2))
            .min_by(|a, b| {
                let size = |p: &Part| p.columns.len() + p.effect.refined().len();
                size(&a.0)
                    .cmp(&size(&b.0))
                    .then(a.1.left_out_squares().total_cmp(&b.1.left_out_squares()))
            })?;
        Some(part.clone())
    }

    /// Takes the shape on trial that is best now: what was noise beside a missing
    /// effect may be told from it once that is there.
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
                while step > 0.01 {
                    let mut moved = false;
                    for factor in [f64::exp(step), f64::exp(-step)] {
                        let mut shape = part.shape.clone();
                        shape[i] *= factor;
                        let columns = design::columns(self.motions, part.effect, &shape);
                        let found = cost(&columns);
                        if found < least * (1.0 - 1e-4) {
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
        while self.parts.len() > 1 {
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
    fn judge(&mut self, candidates: &[Part], kinds: usize) {
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
            columns: design::columns(motions, effect, &shape),
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

/// Part by which the error of what was left out falls from `current` to `better`.
fn gain(current: &Fit, better: &Fit) -> f64 {
    1.0 - (better.left_out_squares() / current.left_out_squares()).sqrt()
}

/// Whether `better` is better than `current` for certain, on what was left out.
fn certain(current: &Fit, better: &Fit, kinds: usize) -> bool {
    gain(current, better) >= LEAST_GAIN && p_value(current, better) * (kinds as f64) < FALSE_ALARM
}

/// Probability that the error falls by chance as it does, stretch by stretch:
/// Student's t on the logarithm of the ratio of squared errors.
fn p_value(current: &Fit, better: &Fit) -> f64 {
    let ratios: Vec<f64> = current
        .left_out
        .iter()
        .zip(&better.left_out)
        .filter(|(a, b)| **a > 0.0 && **b > 0.0)
        .map(|(a, b)| (a / b).ln())
        .collect();
    let n = ratios.len() as f64;
    if n < 3.0 {
        return 1.0;
    }
    let mean = ratios.iter().sum::<f64>() / n;
    let variance = ratios.iter().map(|r| (r - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let t = mean / (variance / n).sqrt().max(f64::MIN_POSITIVE);
    student_tail(t, n - 1.0)
}

/// `P(T > t)` of Student's distribution.
fn student_tail(t: f64, freedom: f64) -> f64 {
    use special::Beta;
    let x = freedom / (freedom + t * t);
    let (a, b) = (0.5 * freedom, 0.5);
    let both = x.inc_beta(a, b, a.ln_beta(b));
    if t > 0.0 {
        0.5 * both
    } else {
        1.0 - 0.5 * both
    }
}

/// Rows over which a residual stays like itself: `1 + 2 sum rho_k`, up to the
/// first that is not positive.
fn correlation_rows(rest: &[f64], table: &Table) -> f64 {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Tables of Student's distribution: 5 % above 1.833 with 9 degrees of freedom.
    #[test]
    fn student() {
        assert!((student_tail(1.833, 9.0) - 0.05).abs() < 1e-4);
        assert!((student_tail(-1.833, 9.0) - 0.95).abs() < 1e-4);
        assert!((student_tail(3.250, 9.0) - 0.005).abs() < 1e-5);
    }
}
