//! Parameters that all streams share.

use faer::Mat;

use super::fit::{Base, Data, FOLDS};
use super::sums::{Eliminated, Fitted, Sums, add, solved, strained, test_error, totals};

impl Data {
    /// How well base and candidate do in each stream with one set of parameters for
    /// all; and `sum (b / std)^2` of these, for each right-hand side.
    pub(super) fn shared(
        &self,
        base: &Base,
        sums: &[Option<Sums>],
        priors: &[f64],
        overdispersion: &[f64],
    ) -> (Vec<Option<Fitted>>, Vec<f64>) {
        let beside = |by: &Eliminated, shared: &Mat<f64>| {
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
        let (shared, reduced) = self.shared_solution(base, sums, priors, overdispersion, None);
        let mut fitted: Vec<Option<Fitted>> = reduced
            .iter()
            .enumerate()
            .map(|(k, reduced)| {
                reduced.as_ref().map(|reduced| Fitted {
                    errors: vec![0.0; shared.ncols()],
                    strained: strained(&beside(reduced, &shared), &self.ridge(k, &base.columns[k])),
                })
            })
            .collect();
        for fold in 0..FOLDS {
            let (shared, reduced) =
                self.shared_solution(base, sums, priors, overdispersion, Some(fold));
            for ((fitted, sums), reduced) in fitted.iter_mut().zip(sums).zip(&reduced) {
                if let (Some(fitted), Some(sums), Some(reduced)) = (fitted, sums, reduced) {
                    let solution = beside(reduced, &shared);
                    add(&mut fitted.errors, &test_error(sums, fold, &solution));
                }
            }
        }
        let ridge: Vec<f64> = priors.iter().map(|p| 1.0 / (p * p)).collect();
        (fitted, strained(&shared, &ridge))
    }

    /// The shared parameters without `fold`: each stream's base is eliminated,
    /// what is left is summed over the streams. With it, what each stream says.
    pub(super) fn shared_solution(
        &self,
        base: &Base,
        sums: &[Option<Sums>],
        priors: &[f64],
        overdispersion: &[f64],
        fold: Option<usize>,
    ) -> (Mat<f64>, Vec<Option<Eliminated>>) {
        let c = priors.len();
        let sides = sums.iter().flatten().map(|s| s.square[0].len()).max();
        let mut normal = Mat::<f64>::zeros(c, c);
        for (i, prior) in priors.iter().enumerate() {
            normal[(i, i)] = 1.0 / (prior * prior);
        }
        let mut right = Mat::<f64>::zeros(c, sides.unwrap_or(1));
        let reduced: Vec<Option<Eliminated>> = sums
            .iter()
            .enumerate()
            .map(|(k, sums)| sums.as_ref().map(|s| self.reduced(base, k, s, fold)))
            .collect();
        for (k, reduced) in reduced.iter().enumerate() {
            if let Some(Eliminated { own, told, .. }) = reduced {
                let weight = self.weight(base, k, 0) / overdispersion[k];
                normal += weight * own;
                right += weight * told;
            }
        }
        (solved(normal, &right, &vec![0.0; c]), reduced)
    }

    /// By how much what each stream says of shared parameters spreads more than
    /// its noise from draw to draw, where the truth is none; 1 or more:
    ///
    /// `mean(b' A^-1 b) / c`, `A` and `b` the normal equations of c parameters.
    ///
    /// Vibrations are simulated less well than the noise of a gauge would tell.
    pub(super) fn overdispersion(&self, base: &Base, sums: &[Option<Sums>]) -> Vec<f64> {
        sums.iter()
            .enumerate()
            .map(|(k, sums)| {
                let Some(sums) = sums else { return 1.0 };
                let Eliminated { own, told, .. } = self.reduced(base, k, sums, None);
                let (c, sides) = (told.nrows(), told.ncols());
                let solution = solved(own, &told, &vec![0.0; c]);
                let distances = (1..sides).map(|r| {
                    let dot: f64 = (0..c).map(|i| told[(i, r)] * solution[(i, r)]).sum();
                    self.weight(base, k, r) * dot
                });
                let mean = distances.sum::<f64>() / (c * (sides - 1).max(1)) as f64;
                mean.max(1.0)
            })
            .collect()
    }

    /// Inverse variance of what is new in a sample of stream `k` by what the base
    /// leaves of right-hand side `r`.
    fn weight(&self, base: &Base, k: usize, r: usize) -> f64 {
        let stream = &self.streams[k];
        stream.count / (base.fitted[k].errors[r].max(1e-300) * stream.inflation)
    }

    /// What stream `k` says of a candidate, without `fold`, once its base has taken
    /// what it explains.
    fn reduced(&self, base: &Base, k: usize, sums: &Sums, fold: Option<usize>) -> Eliminated {
        let (mut gram, mut right) = totals(sums);
        if let Some(fold) = fold {
            gram -= &sums.gram[fold];
            right -= &sums.right[fold];
        }
        Eliminated::new(&gram, &right, &self.ridge(k, &base.columns[k]))
    }
}
