//! A candidate beside what is in the model already: its evidence, and its parameters.

use super::effect::{Coupling, Effect};
use super::fit::{Base, Data};
use super::observed::Observed;
use super::stream::Columns;
use super::sums::{Fitted, Sums, left_out, solved, totals};

/// How well a candidate did.
#[derive(Clone, Debug)]
pub struct Trial {
    /// Its shape.
    pub shape: Vec<f64>,
    /// Linear parameters of each stream about which its terms were taken;
    /// none where they are the same everywhere.
    pub about: Vec<Vec<f64>>,
    /// Logarithm of the evidence on left-out blocks.
    pub score: f64,
    /// The same with each stream's part over its overdispersion: what counts beside chance.
    pub tempered: f64,
    /// The tempered evidence of each draw without effect.
    pub null: Vec<f64>,
    /// Part of each stream.
    pub streams: Vec<f64>,
    /// By which part what the base leaves of each stream has more squares than draws without effect.
    pub excess: Vec<f64>,
    /// By how much what each stream says of shared parameters spreads more than
    /// its noise, from draw to draw without effect; 1 or more.
    pub overdispersion: Vec<f64>,
}

/// A candidate with what it is tried beside.
pub(super) struct Tried<'a, S: Observed> {
    pub base: &'a Base,
    pub effect: &'a dyn Effect<S>,
    pub shape: &'a [f64],
    /// `[parameter][stream]`.
    pub columns: &'a [Columns],
}

impl Data {
    /// Evidence of `effect` with the columns of its linear parameters
    /// (`columns[parameter][stream]`), beside `base`: with the draws, or without them
    /// where their `overdispersion` is known.
    pub fn trial<S: Observed>(
        &self,
        base: &Base,
        effect: &dyn Effect<S>,
        shape: &[f64],
        columns: &[Columns],
        overdispersion: Option<&[f64]>,
    ) -> Trial {
        let sides = self.sides_of(overdispersion);
        let sums = self.sums_by_stream(base, &self.by_stream(columns), sides);
        let tried = Tried {
            base,
            effect,
            shape,
            columns,
        };
        self.judged(&tried, &sums, overdispersion)
    }

    /// As [`Self::trial`], of several and with the draws: stream by stream, so that what all are
    /// held against is read from memory once.
    pub(super) fn trials<S: Observed>(&self, all: &[Tried<'_, S>]) -> Vec<Trial> {
        let columns: Vec<_> = all.iter().map(|t| self.by_stream(t.columns)).collect();
        let mut sums: Vec<Vec<Option<Sums>>> = vec![Vec::new(); all.len()];
        for k in 0..self.streams.len() {
            for ((tried, columns), sums) in all.iter().zip(&columns).zip(&mut sums) {
                sums.push(self.sums_of_stream(tried.base, k, &columns[k], self.sides()));
            }
        }
        (all.iter().zip(&sums))
            .map(|(tried, sums)| self.judged(tried, sums, None))
            .collect()
    }

    /// Right-hand sides that are tried: the residual, and the draws where they are to tell the
    /// `overdispersion`.
    fn sides_of(&self, overdispersion: Option<&[f64]>) -> usize {
        if overdispersion.is_none() {
            self.sides()
        } else {
            1
        }
    }

    /// What the `sums` of each stream say of what was tried.
    fn judged<S: Observed>(
        &self,
        &Tried {
            base,
            effect,
            shape,
            ..
        }: &Tried<'_, S>,
        sums: &[Option<Sums>],
        overdispersion: Option<&[f64]>,
    ) -> Trial {
        let sides = self.sides_of(overdispersion);
        let priors: Vec<f64> = effect.linear().iter().map(|l| l.prior_std).collect();
        let (fitted, strained, overdispersion) = match effect.coupling() {
            Coupling::Own => (
                self.own(base, sums, &priors),
                vec![0.0; sides],
                vec![1.0; self.streams.len()],
            ),
            Coupling::Shared => {
                let overdispersion =
                    overdispersion.map_or_else(|| self.overdispersion(base, sums), <[f64]>::to_vec);
                let (fitted, strained) = self.shared(base, sums, &priors, &overdispersion);
                (fitted, strained, overdispersion)
            }
        };
        let gain = |without: &[Fitted], k: usize, r: usize, overdispersion: f64| match &fitted[k] {
            Some(fitted) => {
                let without = &without[k];
                let relieved = (without.strained[r] - fitted.strained[r]) / self.tempered(k);
                let ratio = without.errors[r] / fitted.errors[r].max(1e-300);
                0.5 * (self.independent(k) / overdispersion * ratio.ln() + relieved)
            }
            None => 0.0,
        };
        let sum = |without: &[Fitted], r: usize, overdispersion: &dyn Fn(usize) -> f64| -> f64 {
            let gains = (0..self.streams.len()).map(|k| {
                let gain = gain(without, k, r, overdispersion(k));
                match effect.coupling() {
                    // A channel that the effect does not act on has none of it.
                    Coupling::Own => gain.max(0.0),
                    Coupling::Shared => gain,
                }
            });
            gains.sum::<f64>() - 0.5 * strained[r]
        };
        let own = |k: usize| overdispersion[k];
        Trial {
            shape: shape.to_vec(),
            about: Vec::new(),
            // Candidates are compared by the same noise.
            score: sum(&base.before, 0, &|_| 1.0),
            tempered: sum(&base.fitted, 0, &own),
            null: (1..sides).map(|r| sum(&base.fitted, r, &own)).collect(),
            streams: (0..self.streams.len())
                .map(|k| gain(&base.before, k, 0, 1.0))
                .collect(),
            excess: base.before.iter().map(excess).collect(),
            overdispersion,
        }
    }

    /// Linear parameters of `effect` beside `base`, by all the data: for each
    /// stream, empty where it does not act.
    pub fn parameters<S: Observed>(
        &self,
        base: &Base,
        effect: &dyn Effect<S>,
        columns: &[Columns],
        overdispersion: &[f64],
    ) -> Vec<Vec<f64>> {
        let columns = self.by_stream(columns);
        let priors: Vec<f64> = effect.linear().iter().map(|l| l.prior_std).collect();
        let sums = self.sums_by_stream(base, &columns, 1);
        match effect.coupling() {
            Coupling::Own => sums
                .iter()
                .enumerate()
                .map(|(k, sums)| {
                    let Some(sums) = sums else { return Vec::new() };
                    let (gram, right) = totals(sums);
                    let solution = solved(gram, &right, &self.ridge_with(base, k, &priors));
                    let first = base.columns[k].len();
                    (first..solution.nrows())
                        .map(|i| solution[(i, 0)])
                        .collect()
                })
                .collect(),
            Coupling::Shared => {
                let (shared, _) = self.shared_solution(base, &sums, &priors, overdispersion, None);
                let all: Vec<f64> = (0..priors.len()).map(|i| shared[(i, 0)]).collect();
                sums.iter()
                    .map(|s| s.as_ref().map_or(Vec::new(), |_| all.clone()))
                    .collect()
            }
        }
    }

    /// Columns of each stream; none where one is missing.
    fn by_stream<'a>(&self, columns: &'a [Columns]) -> Vec<Vec<&'a [f64]>> {
        (0..self.streams.len())
            .map(|k| {
                let own: Vec<&[f64]> = columns.iter().map(|c| c[k].as_slice()).collect();
                if own.iter().any(|c| c.is_empty()) {
                    Vec::new()
                } else {
                    own
                }
            })
            .collect()
    }

    /// Sums of base and candidate where the candidate acts on something known.
    fn sums_by_stream(
        &self,
        base: &Base,
        columns: &[Vec<&[f64]>],
        sides: usize,
    ) -> Vec<Option<Sums>> {
        (columns.iter().enumerate())
            .map(|(k, own)| self.sums_of_stream(base, k, own, sides))
            .collect()
    }

    fn sums_of_stream(&self, base: &Base, k: usize, own: &[&[f64]], sides: usize) -> Option<Sums> {
        let acts = !own.is_empty() && self.streams[k].count > 0.0;
        acts.then(|| self.joined(base, k, own, sides))
    }

    fn ridge_with(&self, base: &Base, k: usize, priors: &[f64]) -> Vec<f64> {
        let mut ridge = self.ridge(k, &base.columns[k]);
        ridge.extend(priors.iter().map(|p| self.tempered(k) / (p * p)));
        ridge
    }

    fn own(&self, base: &Base, sums: &[Option<Sums>], priors: &[f64]) -> Vec<Option<Fitted>> {
        sums.iter()
            .enumerate()
            .map(|(k, sums)| {
                sums.as_ref()
                    .map(|sums| left_out(sums, &self.ridge_with(base, k, priors)))
            })
            .collect()
    }
}

/// By which part the errors of the first right-hand side are larger than those of the others, the draws.
fn excess(fitted: &Fitted) -> f64 {
    let draws = &fitted.errors[1..];
    let clean = draws.iter().sum::<f64>() / draws.len().max(1) as f64;
    fitted.errors[0] / clean.max(1e-300) - 1.0
}
