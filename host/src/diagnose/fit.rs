//! Least squares of candidates against the residuals, judged on blocks that
//! were left out.
//!
//! For each stream and fold only sums of products are kept, so that leaving a
//! fold out is a subtraction, and draws of the null hypothesis are further
//! right-hand sides of the same sums.

use std::borrow::Cow;

use faer::Mat;

use super::columns::nuisances_of;
use super::effect::{Coupling, Effect};
use super::observed::Observed;
use super::stream::Columns;
use super::sums::{Fitted, Sums, dot, dots, left_out, mirror, solved, totals};

/// Folds of the cross-validation.
pub const FOLDS: usize = 8;

/// A column of one stream, with the standard deviation that its coefficient has.
#[derive(Clone, Debug)]
pub struct Prior {
    /// The column.
    pub column: Vec<f64>,
    /// Standard deviation of its coefficient.
    pub std: f64,
}

/// All recordings, stream by stream, one after another.
pub struct Data {
    /// Residual, and draws of the residual without any effect.
    pub(super) streams: Vec<StreamData>,
    /// Runs of samples of one fold.
    blocks: Vec<(std::ops::Range<usize>, usize)>,
    draws: usize,
}

pub(super) struct StreamData {
    /// 1 where the residual is known, else 0.
    mask: Vec<f64>,
    pub(super) count: f64,
    /// Residual first, then the draws; 0 where not known.
    right: Vec<Vec<f64>>,
    /// Samples of noise for one that tells something new.
    pub(super) inflation: f64,
    variance: f64,
}

/// What is in the model already: nuisances and accepted effects.
#[derive(Clone)]
pub struct Base {
    pub(super) columns: Vec<Vec<Prior>>,
    sums: Vec<Sums>,
    /// How well it does in each stream.
    pub(super) fitted: Vec<Fitted>,
    /// The same without the nuisances that go with a candidate.
    before: Vec<Fitted>,
}

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
    pub effect: &'static dyn Effect<S>,
    pub shape: &'a [f64],
    /// `[parameter][stream]`.
    pub columns: &'a [Columns],
}

impl Data {
    /// Lays out `sessions`; `draws[m][session][stream]` are residuals without effect.
    pub fn new<S: Observed>(sessions: &[S], draws: &[Vec<Vec<Vec<f64>>>]) -> Self {
        let mut blocks = Vec::new();
        let mut from = 0;
        for session in sessions {
            let length = session.block();
            let n = session.speed().len();
            for (number, start) in (0..n).step_by(length).enumerate() {
                // Neighbours fall into different folds, without a period.
                let fold = (number * 5 + number / FOLDS * 3) % FOLDS;
                blocks.push((from + start..from + (start + length).min(n), fold));
            }
            from += n;
        }
        let streams = (0..sessions[0].streams().len())
            .map(|k| {
                let joined = |of: &dyn Fn(usize) -> Vec<f64>| -> Vec<f64> {
                    (0..sessions.len()).flat_map(of).collect()
                };
                let residual = joined(&|s| sessions[s].residual(k).to_vec());
                let mask: Vec<f64> = residual
                    .iter()
                    .map(|r| f64::from(u8::from(r.is_finite())))
                    .collect();
                let known = |x: Vec<f64>| -> Vec<f64> {
                    x.iter()
                        .map(|v| if v.is_finite() { *v } else { 0.0 })
                        .collect()
                };
                let mut right = vec![known(residual)];
                for draw in draws {
                    let mut drawn = known(joined(&|s| draw[s][k].clone()));
                    drawn.resize(mask.len(), 0.0);
                    for (value, mask) in drawn.iter_mut().zip(&mask) {
                        *value *= mask;
                    }
                    right.push(drawn);
                }
                let noise_std = sessions[0].noise_std(k);
                StreamData {
                    count: mask.iter().sum(),
                    mask,
                    right,
                    inflation: sessions[0].inflation(k),
                    variance: noise_std * noise_std,
                }
            })
            .collect();
        Self {
            streams,
            blocks,
            draws: draws.len(),
        }
    }

    /// Number of right-hand sides.
    fn sides(&self) -> usize {
        1 + self.draws
    }

    /// Independent samples of stream `k`.
    pub fn independent(&self, k: usize) -> f64 {
        self.streams[k].count / self.streams[k].inflation
    }

    /// Squares that evidence `gain` in stream `k` explains, over the mean square that it leaves.
    pub fn squares(&self, k: usize, gain: f64) -> f64 {
        let n = self.independent(k);
        n * (2.0 * gain / n).exp_m1()
    }

    /// The base of the columns of each stream.
    pub fn base(&self, columns: Vec<Vec<Prior>>) -> Base {
        let sums: Vec<Sums> = columns
            .iter()
            .enumerate()
            .map(|(k, own)| {
                let columns: Vec<&[f64]> = own.iter().map(|p| p.column.as_slice()).collect();
                self.sums(k, &[], &columns, self.sides())
            })
            .collect();
        let fitted = self.fitted(&columns, &sums);
        Base {
            columns,
            sums,
            before: fitted.clone(),
            fitted,
        }
    }

    /// Mean square of what `base` leaves of each draw, on blocks that were left out:
    /// `[stream][draw]`.
    pub(super) fn left_of_draws(&self, base: &Base) -> Vec<Vec<f64>> {
        let per_sample = |(fitted, stream): (&Fitted, &StreamData)| {
            let errors = fitted.errors[1..].iter();
            errors.map(|error| error / stream.count.max(1.0)).collect()
        };
        base.fitted
            .iter()
            .zip(&self.streams)
            .map(per_sample)
            .collect()
    }

    /// How well `columns` do in each stream.
    fn fitted(&self, columns: &[Vec<Prior>], sums: &[Sums]) -> Vec<Fitted> {
        let streams = columns.iter().zip(sums).enumerate();
        streams
            .map(|(k, (columns, sums))| left_out(sums, &self.ridge(k, columns)))
            .collect()
    }

    /// `base` with the nuisances that go with `effect`: what they explain counts as evidence for
    /// it, not as what chance does not reach.
    pub(super) fn with_nuisances<'a, S: Observed>(
        &self,
        base: &'a Base,
        sessions: &[S],
        effect: &dyn Effect<S>,
        shape: &[f64],
    ) -> Cow<'a, Base> {
        let mut columns = nuisances_of(sessions, effect, shape);
        if columns.iter().all(Vec::is_empty) {
            return Cow::Borrowed(base);
        }
        let sums: Vec<Sums> = (columns.iter().enumerate())
            .map(|(k, further)| {
                let further: Vec<&[f64]> = further.iter().map(|p| p.column.as_slice()).collect();
                self.joined(base, k, &further, self.sides())
            })
            .collect();
        for (further, known) in columns.iter_mut().zip(&base.columns) {
            further.splice(..0, known.iter().cloned());
        }
        Cow::Owned(Base {
            fitted: self.fitted(&columns, &sums),
            columns,
            sums,
            before: base.before.clone(),
        })
    }

    /// Squared deviations of samples of stream `k` that tell as much as one squared
    /// standard deviation of a parameter.
    fn tempered(&self, k: usize) -> f64 {
        self.streams[k].variance * self.streams[k].inflation
    }

    pub(super) fn ridge(&self, k: usize, columns: &[Prior]) -> Vec<f64> {
        columns
            .iter()
            .map(|p| self.tempered(k) / (p.std * p.std))
            .collect()
    }

    /// Sums of `own` with `base`, with each other, and with the right-hand sides;
    /// the base's sums with itself are left 0.
    fn sums(&self, k: usize, base: &[Prior], own: &[&[f64]], sides: usize) -> Sums {
        let (q, c) = (base.len(), own.len());
        let stream = &self.streams[k];
        let mut sums = Sums {
            gram: vec![Mat::zeros(q + c, q + c); FOLDS],
            right: vec![Mat::zeros(q + c, sides); FOLDS],
            square: vec![vec![0.0; sides]; FOLDS],
        };
        let masked: Vec<Vec<f64>> = own
            .iter()
            .map(|column| {
                column
                    .iter()
                    .zip(&stream.mask)
                    .map(|(v, m)| v * m)
                    .collect()
            })
            .collect();
        let mut products = Vec::new();
        for (range, fold) in &self.blocks {
            for (i, x) in masked.iter().enumerate() {
                let columns = (base.iter().map(|p| &p.column)).chain(&masked[..=i]);
                let all = columns.chain(&stream.right[..sides]);
                dots(
                    &x[range.clone()],
                    all.map(|y| &y[range.clone()]),
                    &mut products,
                );
                let (columns, right) = products.split_at(q + i + 1);
                for (j, product) in columns.iter().enumerate() {
                    sums.gram[*fold][(q + i, j)] += product;
                }
                for (r, product) in right.iter().enumerate() {
                    sums.right[*fold][(q + i, r)] += product;
                }
            }
            if q == 0 {
                for (r, y) in stream.right[..sides].iter().enumerate() {
                    let y = &y[range.clone()];
                    sums.square[*fold][r] += dot(y, y);
                }
            }
        }
        for gram in &mut sums.gram {
            mirror(gram);
        }
        sums
    }

    /// Base and candidate together.
    fn joined(&self, base: &Base, k: usize, own: &[&[f64]], sides: usize) -> Sums {
        let columns = &base.columns[k];
        let q = columns.len();
        let mut sums = self.sums(k, columns, own, sides);
        for fold in 0..FOLDS {
            let known = &base.sums[k];
            for i in 0..q {
                for j in 0..q {
                    sums.gram[fold][(i, j)] = known.gram[fold][(i, j)];
                }
                for r in 0..sides {
                    sums.right[fold][(i, r)] = known.right[fold][(i, r)];
                }
            }
            sums.square[fold] = known.square[fold][..sides].to_vec();
        }
        sums
    }

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
        let sides = if overdispersion.is_none() {
            self.sides()
        } else {
            1
        };
        let sums = self.sums_by_stream(base, &self.by_stream(columns), sides);
        self.judged(base, effect, shape, &sums, overdispersion)
    }

    /// The same of several with the draws: stream by stream, so that what all are held against is
    /// read from memory once.
    pub(super) fn trials<S: Observed>(&self, all: &[Tried<'_, S>]) -> Vec<Trial> {
        let columns: Vec<_> = all.iter().map(|t| self.by_stream(t.columns)).collect();
        let mut sums: Vec<Vec<Option<Sums>>> = vec![Vec::new(); all.len()];
        for k in 0..self.streams.len() {
            for ((tried, columns), sums) in all.iter().zip(&columns).zip(&mut sums) {
                sums.push(self.sums_of_stream(tried.base, k, &columns[k], self.sides()));
            }
        }
        (all.iter().zip(&sums))
            .map(|(t, sums)| self.judged(t.base, t.effect, t.shape, sums, None))
            .collect()
    }

    /// Evidence of `effect` by the `sums` of each stream.
    fn judged<S: Observed>(
        &self,
        base: &Base,
        effect: &dyn Effect<S>,
        shape: &[f64],
        sums: &[Option<Sums>],
        overdispersion: Option<&[f64]>,
    ) -> Trial {
        let sides = if overdispersion.is_none() {
            self.sides()
        } else {
            1
        };
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
