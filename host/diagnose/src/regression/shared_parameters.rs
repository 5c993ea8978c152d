//! Fits a candidate whose parameters all signals share by cross-validated least squares, and
//! estimates the overdispersion of each signal from the null samples.

use faer::Mat;

use crate::regression::cross_validation::{BaseModel, RegressionData};
use crate::regression::normal_equations::FOLDS;
use crate::regression::normal_equations::{
    CrossValidated, NormalEquations, SchurComplement, add, prior_penalty, solve_ridge, sum_folds,
    test_error,
};

impl RegressionData {
    /// How well base and candidate do in each signal with one set of parameters for
    /// all; and `sum (b / std)^2` of these, for each right-hand side.
    pub(crate) fn fit_pooled(
        &self,
        base: &BaseModel,
        sums: &[Option<NormalEquations>],
        priors: &[f64],
        overdispersion: &[f64],
    ) -> (Vec<Option<CrossValidated>>, Vec<f64>) {
        let beside = |by: &SchurComplement, shared: &Mat<f64>| {
            let based = &by.free - &by.by * shared;
            let q = based.nrows();
            Mat::from_fn(q + shared.nrows(), based.ncols(), |i, r| {
                if i < q {
                    based[(i, r)]
                } else {
                    shared[(i - q, r)]
                }
            })
        };
        let (shared, reduced) = self.pooled_solution(base, sums, priors, overdispersion, None);
        let mut fitted: Vec<Option<CrossValidated>> = reduced
            .iter()
            .enumerate()
            .map(|(k, reduced)| {
                reduced.as_ref().map(|reduced| CrossValidated {
                    sse: vec![0.0; shared.ncols()],
                    prior_penalty: prior_penalty(
                        &beside(reduced, &shared),
                        &self.ridge(k, &base.columns[k]),
                    ),
                })
            })
            .collect();
        for fold in 0..FOLDS {
            let (shared, reduced) =
                self.pooled_solution(base, sums, priors, overdispersion, Some(fold));
            for ((fitted, sums), reduced) in fitted.iter_mut().zip(sums).zip(&reduced) {
                if let (Some(fitted), Some(sums), Some(reduced)) = (fitted, sums, reduced) {
                    let solution = beside(reduced, &shared);
                    add(&mut fitted.sse, &test_error(sums, fold, &solution));
                }
            }
        }
        let ridge: Vec<f64> = priors.iter().map(|p| 1.0 / (p * p)).collect();
        (fitted, prior_penalty(&shared, &ridge))
    }

    /// The shared parameters without `fold`: each signal's base is eliminated,
    /// the reduced normal equations are summed over the signals. Also those of each signal.
    pub(crate) fn pooled_solution(
        &self,
        base: &BaseModel,
        sums: &[Option<NormalEquations>],
        priors: &[f64],
        overdispersion: &[f64],
        fold: Option<usize>,
    ) -> (Mat<f64>, Vec<Option<SchurComplement>>) {
        let c = priors.len();
        let rhs_count = sums.iter().flatten().map(|s| s.square[0].len()).max();
        let mut normal = Mat::<f64>::zeros(c, c);
        for (i, prior) in priors.iter().enumerate() {
            normal[(i, i)] = 1.0 / (prior * prior);
        }
        let mut right = Mat::<f64>::zeros(c, rhs_count.unwrap_or(1));
        let reduced: Vec<Option<SchurComplement>> = sums
            .iter()
            .enumerate()
            .map(|(k, sums)| sums.as_ref().map(|s| self.eliminate_own(base, k, s, fold)))
            .collect();
        for (k, reduced) in reduced.iter().enumerate() {
            if let Some(SchurComplement {
                own,
                right: projected,
                ..
            }) = reduced
            {
                let weight = self.weight(base, k, 0) / overdispersion[k];
                normal += weight * own;
                right += weight * projected;
            }
        }
        (solve_ridge(normal, &right, &vec![0.0; c]), reduced)
    }

    /// Overdispersion: scatter of a signal's estimate of shared parameters over the null samples, whose
    /// true parameters are 0, relative to its noise; 1 or more:
    ///
    /// `mean(b' A^-1 b) / c`, `A` and `b` the normal equations of c parameters.
    ///
    /// Vibrations are simulated less well than the noise of a gauge suggests.
    pub(crate) fn overdispersion(
        &self,
        base: &BaseModel,
        sums: &[Option<NormalEquations>],
    ) -> Vec<f64> {
        sums.iter()
            .enumerate()
            .map(|(k, sums)| {
                let Some(sums) = sums else { return 1.0 };
                let SchurComplement {
                    own,
                    right: projected,
                    ..
                } = self.eliminate_own(base, k, sums, None);
                let (c, rhs_count) = (projected.nrows(), projected.ncols());
                let solution = solve_ridge(own, &projected, &vec![0.0; c]);
                let distances = (1..rhs_count).map(|r| {
                    let dot: f64 = (0..c).map(|i| projected[(i, r)] * solution[(i, r)]).sum();
                    self.weight(base, k, r) * dot
                });
                let mean = distances.sum::<f64>() / (c * (rhs_count - 1).max(1)) as f64;
                mean.max(1.0)
            })
            .collect()
    }

    /// Inverse variance of an independent sample of signal `k`, from the residual of
    /// the base for right-hand side `r`.
    fn weight(&self, base: &BaseModel, k: usize, r: usize) -> f64 {
        let signal = &self.signals[k];
        signal.count / (base.fitted[k].sse[r].max(1e-300) * signal.samples_per_independent)
    }

    /// Normal equations of a candidate in signal `k`, without `fold`, after elimination of
    /// its base.
    fn eliminate_own(
        &self,
        base: &BaseModel,
        k: usize,
        sums: &NormalEquations,
        fold: Option<usize>,
    ) -> SchurComplement {
        let (mut gram, mut right) = sum_folds(sums);
        if let Some(fold) = fold {
            gram -= &sums.gram[fold];
            right -= &sums.right[fold];
        }
        SchurComplement::new(&gram, &right, &self.ridge(k, &base.columns[k]))
    }
}
