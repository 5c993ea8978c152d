//! Lays out residuals and null samples in folds of blocks for the cross-validated regression, and
//! sums the normal equations of the base model and of candidates for each fold.
//!
//! For each signal and fold only sums of products are kept, so that leaving a
//! fold out is a subtraction, and null samples of the null hypothesis are further
//! right-hand sides of the same sums.

use std::borrow::Cow;

use faer::Mat;

use crate::candidate_effect::Effect;
use crate::regression::design_matrix::nuisances_of;
use crate::regression::normal_equations::{
    CrossValidated, FOLDS, NormalEquations, cross_validate, dot, dots, symmetrise,
};
use crate::residual_model::ResidualModel;

/// A column of one signal, with the standard deviation that its coefficient has.
#[derive(Clone, Debug)]
pub struct PriorColumn {
    /// The column.
    pub column: Vec<f64>,
    /// Standard deviation of its coefficient.
    pub std: f64,
}

/// All recordings, signal by signal, one after another.
pub struct RegressionData {
    /// Residual, and null samples of the residual without any effect.
    pub(crate) signals: Vec<SignalData>,
    /// Runs of samples of one fold.
    blocks: Vec<(std::ops::Range<usize>, usize)>,
    null_samples: usize,
}

pub(crate) struct SignalData {
    /// 1 where the residual is known, else 0.
    mask: Vec<f64>,
    pub(crate) count: f64,
    /// Residual first, then the null samples; 0 where not known.
    right: Vec<Vec<f64>>,
    /// Samples per independent sample.
    pub(crate) samples_per_independent: f64,
    variance: f64,
}

/// The terms already in the model: nuisances and accepted effects.
#[derive(Clone)]
pub struct BaseModel {
    pub(crate) columns: Vec<Vec<PriorColumn>>,
    sums: Vec<NormalEquations>,
    /// How well it does in each signal.
    pub(crate) fitted: Vec<CrossValidated>,
    /// The same without the nuisances that go with a candidate.
    pub(crate) without_candidate_nuisances: Vec<CrossValidated>,
}

impl RegressionData {
    /// Lays out `recordings`; `null_samples[m][recording][signal]` are residuals without effect.
    pub fn new<S: ResidualModel>(recordings: &[S], null_samples: &[Vec<Vec<Vec<f64>>>]) -> Self {
        let mut blocks = Vec::new();
        let mut from = 0;
        for recording in recordings {
            let length = recording.block();
            let n = recording.speed().len();
            // Counted through: the first blocks of many short recordings are not of one fold.
            for start in (0..n).step_by(length) {
                let number = blocks.len();
                // Neighbours fall into different folds, without a period.
                let fold = (number * 5 + number / FOLDS * 3) % FOLDS;
                blocks.push((from + start..from + (start + length).min(n), fold));
            }
            from += n;
        }
        let signals = (0..recordings[0].residuals().len())
            .map(|k| {
                let concatenate = |of: &dyn Fn(usize) -> Vec<f64>| -> Vec<f64> {
                    (0..recordings.len()).flat_map(of).collect()
                };
                let residual = concatenate(&|s| recordings[s].residual(k).to_vec());
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
                for null_sample in null_samples {
                    let mut drawn = known(concatenate(&|s| null_sample[s][k].clone()));
                    drawn.resize(mask.len(), 0.0);
                    for (value, mask) in drawn.iter_mut().zip(&mask) {
                        *value *= mask;
                    }
                    right.push(drawn);
                }
                let noise_std = recordings[0].noise_std(k);
                SignalData {
                    count: mask.iter().sum(),
                    mask,
                    right,
                    samples_per_independent: recordings[0].samples_per_independent(k),
                    variance: noise_std * noise_std,
                }
            })
            .collect();
        Self {
            signals,
            blocks,
            null_samples: null_samples.len(),
        }
    }

    /// Number of right-hand sides.
    pub(crate) fn rhs_count(&self) -> usize {
        1 + self.null_samples
    }

    /// Independent samples of signal `k`.
    pub fn effective_samples(&self, k: usize) -> f64 {
        self.signals[k].count / self.signals[k].samples_per_independent
    }

    /// Squares that evidence `gain` in signal `k` explains, over the mean square of its residual.
    pub fn explained_sum_of_squares(&self, k: usize, gain: f64) -> f64 {
        let n = self.effective_samples(k);
        n * (2.0 * gain / n).exp_m1()
    }

    /// The base of the columns of each signal.
    pub fn base(&self, columns: Vec<Vec<PriorColumn>>) -> BaseModel {
        let sums: Vec<NormalEquations> = columns
            .iter()
            .enumerate()
            .map(|(k, own)| {
                let columns: Vec<&[f64]> = own.iter().map(|p| p.column.as_slice()).collect();
                self.sums(k, &[], &columns, self.rhs_count())
            })
            .collect();
        let fitted = self.fitted(&columns, &sums);
        BaseModel {
            columns,
            sums,
            without_candidate_nuisances: fitted.clone(),
            fitted,
        }
    }

    /// Mean square of the residual of `base` on each null sample, in hold-out blocks:
    /// `[signal][null_sample]`.
    pub(crate) fn null_mean_squares(&self, base: &BaseModel) -> Vec<Vec<f64>> {
        let per_sample = |(fitted, signal): (&CrossValidated, &SignalData)| {
            let sse = fitted.sse[1..].iter();
            sse.map(|error| error / signal.count.max(1.0)).collect()
        };
        base.fitted
            .iter()
            .zip(&self.signals)
            .map(per_sample)
            .collect()
    }

    /// How well `columns` do in each signal.
    fn fitted(
        &self,
        columns: &[Vec<PriorColumn>],
        sums: &[NormalEquations],
    ) -> Vec<CrossValidated> {
        let signals = columns.iter().zip(sums).enumerate();
        signals
            .map(|(k, (columns, sums))| cross_validate(sums, &self.ridge(k, columns)))
            .collect()
    }

    /// `base` with the nuisances that go with `effect`: what they explain counts as evidence for
    /// it, not as what chance does not reach.
    pub(crate) fn with_nuisances<'a, S: ResidualModel>(
        &self,
        base: &'a BaseModel,
        recordings: &[S],
        effect: &dyn Effect<S>,
        shape: &[f64],
    ) -> Cow<'a, BaseModel> {
        let mut columns = nuisances_of(recordings, effect, shape);
        if columns.iter().all(Vec::is_empty) {
            return Cow::Borrowed(base);
        }
        let sums: Vec<NormalEquations> = (columns.iter().enumerate())
            .map(|(k, further)| {
                let further: Vec<&[f64]> = further.iter().map(|p| p.column.as_slice()).collect();
                self.with_columns(base, k, &further, self.rhs_count())
            })
            .collect();
        for (further, known) in columns.iter_mut().zip(&base.columns) {
            further.splice(..0, known.iter().cloned());
        }
        Cow::Owned(BaseModel {
            fitted: self.fitted(&columns, &sums),
            columns,
            sums,
            without_candidate_nuisances: base.without_candidate_nuisances.clone(),
        })
    }

    /// Squared deviations of samples of signal `k` that carry as much information as one
    /// squared standard deviation of a parameter.
    pub(crate) fn prior_scale(&self, k: usize) -> f64 {
        self.signals[k].variance * self.signals[k].samples_per_independent
    }

    pub(crate) fn ridge(&self, k: usize, columns: &[PriorColumn]) -> Vec<f64> {
        columns
            .iter()
            .map(|p| self.prior_scale(k) / (p.std * p.std))
            .collect()
    }

    /// Sums of `own` with `base`, with each other, and with the right-hand sides;
    /// the base's sums with itself are left 0.
    fn sums(
        &self,
        k: usize,
        base: &[PriorColumn],
        own: &[&[f64]],
        rhs_count: usize,
    ) -> NormalEquations {
        let (q, c) = (base.len(), own.len());
        let signal = &self.signals[k];
        let mut sums = NormalEquations {
            gram: vec![Mat::zeros(q + c, q + c); FOLDS],
            right: vec![Mat::zeros(q + c, rhs_count); FOLDS],
            square: vec![vec![0.0; rhs_count]; FOLDS],
        };
        let masked: Vec<Vec<f64>> = own
            .iter()
            .map(|column| {
                column
                    .iter()
                    .zip(&signal.mask)
                    .map(|(v, m)| v * m)
                    .collect()
            })
            .collect();
        let mut products = Vec::new();
        for (range, fold) in &self.blocks {
            for (i, x) in masked.iter().enumerate() {
                let columns = (base.iter().map(|p| &p.column)).chain(&masked[..=i]);
                let all = columns.chain(&signal.right[..rhs_count]);
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
                for (r, y) in signal.right[..rhs_count].iter().enumerate() {
                    let y = &y[range.clone()];
                    sums.square[*fold][r] += dot(y, y);
                }
            }
        }
        for gram in &mut sums.gram {
            symmetrise(gram);
        }
        sums
    }

    /// Base and candidate together.
    pub(crate) fn with_columns(
        &self,
        base: &BaseModel,
        k: usize,
        own: &[&[f64]],
        rhs_count: usize,
    ) -> NormalEquations {
        let columns = &base.columns[k];
        let q = columns.len();
        let mut sums = self.sums(k, columns, own, rhs_count);
        for fold in 0..FOLDS {
            let known = &base.sums[k];
            for i in 0..q {
                for j in 0..q {
                    sums.gram[fold][(i, j)] = known.gram[fold][(i, j)];
                }
                for r in 0..rhs_count {
                    sums.right[fold][(i, r)] = known.right[fold][(i, r)];
                }
            }
            sums.square[fold] = known.square[fold][..rhs_count].to_vec();
        }
        sums
    }
}
