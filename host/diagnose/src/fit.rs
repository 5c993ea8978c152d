//! Least squares of candidates against the residuals, judged on blocks that
//! were left out.
//!
//! For each stream and fold only sums of products are kept, so that leaving a
//! fold out is a subtraction, and draws of the null hypothesis are further
//! right-hand sides of the same sums.

use std::borrow::Cow;

use faer::Mat;

use super::columns::nuisances_of;
use super::effect::Effect;
use super::observed::Observed;
use super::sums::{Fitted, Sums, dot, dots, left_out, mirror};

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
    pub(super) before: Vec<Fitted>,
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
    pub(super) fn sides(&self) -> usize {
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
    pub(super) fn tempered(&self, k: usize) -> f64 {
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
    pub(super) fn joined(&self, base: &Base, k: usize, own: &[&[f64]], sides: usize) -> Sums {
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
}
