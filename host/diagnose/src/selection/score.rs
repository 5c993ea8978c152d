//! Scores a candidate effect fitted beside the terms already in the model: cross-validated
//! log-evidence for the residual and each null sample, excess, and linear parameters.

use crate::candidate_effect::{Effect, Scope};
use crate::regression::cross_validation::{BaseModel, RegressionData};
use crate::regression::normal_equations::{
    CrossValidated, NormalEquations, cross_validate, solve_ridge, sum_folds,
};
use crate::residual_model::Columns;
use crate::residual_model::ResidualModel;

/// How well a candidate did.
#[derive(Clone, Debug)]
pub struct CandidateScore {
    /// Its shape.
    pub shape: Vec<f64>,
    /// Linear parameters of each signal at which its regressors were linearised;
    /// none where they are the same everywhere.
    pub linearised_at: Vec<Vec<f64>>,
    /// Logarithm of the evidence on left-out blocks.
    pub log_evidence: f64,
    /// The same with each signal's part divided by its overdispersion: compared with null samples.
    pub log_evidence_tempered: f64,
    /// The tempered log-evidence of each null sample.
    pub null: Vec<f64>,
    /// Log-evidence of each signal.
    pub per_signal: Vec<f64>,
    /// Excess of each signal's squares over the null samples, given the base.
    pub excess: Vec<f64>,
    /// Overdispersion: scatter of a signal's estimate of shared parameters over the null samples, relative to
    /// its noise; 1 or more.
    pub overdispersion: Vec<f64>,
}

/// A candidate with the terms that it is tried beside.
pub(crate) struct Candidate<'a, S: ResidualModel> {
    pub base: &'a BaseModel,
    pub effect: &'a dyn Effect<S>,
    pub shape: &'a [f64],
    /// `[parameter][signal]`.
    pub columns: &'a [Columns],
}

impl RegressionData {
    /// Evidence of `effect` with the columns of its linear parameters
    /// (`columns[parameter][signal]`), beside `base`: with the null samples, or without them
    /// where their `overdispersion` is known.
    pub fn trial<S: ResidualModel>(
        &self,
        base: &BaseModel,
        effect: &dyn Effect<S>,
        shape: &[f64],
        columns: &[Columns],
        overdispersion: Option<&[f64]>,
    ) -> CandidateScore {
        let rhs_count = self.sides_of(overdispersion);
        let sums = self.equations_by_signal(base, &self.by_signal(columns), rhs_count);
        let candidate = Candidate {
            base,
            effect,
            shape,
            columns,
        };
        self.score_candidate(&candidate, &sums, overdispersion)
    }

    /// As [`Self::trial`], of several and with the null samples: signal by signal, so that what all are
    /// held against is read from memory once.
    pub(crate) fn trials<S: ResidualModel>(&self, all: &[Candidate<'_, S>]) -> Vec<CandidateScore> {
        let columns: Vec<_> = all.iter().map(|t| self.by_signal(t.columns)).collect();
        let mut sums: Vec<Vec<Option<NormalEquations>>> = vec![Vec::new(); all.len()];
        for k in 0..self.signals.len() {
            for ((candidate, columns), sums) in all.iter().zip(&columns).zip(&mut sums) {
                sums.push(self.equations_of_signal(
                    candidate.base,
                    k,
                    &columns[k],
                    self.rhs_count(),
                ));
            }
        }
        (all.iter().zip(&sums))
            .map(|(candidate, sums)| self.score_candidate(candidate, sums, None))
            .collect()
    }

    /// Right-hand sides that are tried: the residual, and the null samples where they estimate the
    /// `overdispersion`.
    fn sides_of(&self, overdispersion: Option<&[f64]>) -> usize {
        if overdispersion.is_none() {
            self.rhs_count()
        } else {
            1
        }
    }

    /// The fit of the trial to the `sums` of each signal.
    fn score_candidate<S: ResidualModel>(
        &self,
        &Candidate {
            base,
            effect,
            shape,
            ..
        }: &Candidate<'_, S>,
        sums: &[Option<NormalEquations>],
        overdispersion: Option<&[f64]>,
    ) -> CandidateScore {
        let rhs_count = self.sides_of(overdispersion);
        let priors: Vec<f64> = effect
            .linear_parameters()
            .iter()
            .map(|l| l.prior_std)
            .collect();
        let (fitted, prior_penalty, overdispersion) = match effect.scope() {
            Scope::PerSignal => (
                self.own(base, sums, &priors),
                vec![0.0; rhs_count],
                vec![1.0; self.signals.len()],
            ),
            Scope::Machine => {
                let overdispersion =
                    overdispersion.map_or_else(|| self.overdispersion(base, sums), <[f64]>::to_vec);
                let (fitted, prior_penalty) = self.fit_pooled(base, sums, &priors, &overdispersion);
                (fitted, prior_penalty, overdispersion)
            }
        };
        let gain = |subtract_effects: &[CrossValidated],
                    k: usize,
                    r: usize,
                    overdispersion: f64| match &fitted[k] {
            Some(fitted) => {
                let subtract_effects = &subtract_effects[k];
                let relieved = (subtract_effects.prior_penalty[r] - fitted.prior_penalty[r])
                    / self.prior_scale(k);
                let ratio = subtract_effects.sse[r] / fitted.sse[r].max(1e-300);
                0.5 * (self.effective_samples(k) / overdispersion * ratio.ln() + relieved)
            }
            None => 0.0,
        };
        let sum = |subtract_effects: &[CrossValidated],
                   r: usize,
                   overdispersion: &dyn Fn(usize) -> f64|
         -> f64 {
            let gains = (0..self.signals.len()).map(|k| {
                let gain = gain(subtract_effects, k, r, overdispersion(k));
                match effect.scope() {
                    // A channel that the effect does not act on has none of it.
                    Scope::PerSignal => gain.max(0.0),
                    Scope::Machine => gain,
                }
            });
            gains.sum::<f64>() - 0.5 * prior_penalty[r]
        };
        let own = |k: usize| overdispersion[k];
        CandidateScore {
            shape: shape.to_vec(),
            linearised_at: Vec::new(),
            // Candidates are compared by the same noise.
            log_evidence: sum(&base.without_candidate_nuisances, 0, &|_| 1.0),
            log_evidence_tempered: sum(&base.fitted, 0, &own),
            null: (1..rhs_count).map(|r| sum(&base.fitted, r, &own)).collect(),
            per_signal: (0..self.signals.len())
                .map(|k| gain(&base.without_candidate_nuisances, k, 0, 1.0))
                .collect(),
            excess: base
                .without_candidate_nuisances
                .iter()
                .map(excess)
                .collect(),
            overdispersion,
        }
    }

    /// Linear parameters of `effect` beside `base`, by all the data: for each
    /// signal, empty where it does not act.
    pub fn parameters<S: ResidualModel>(
        &self,
        base: &BaseModel,
        effect: &dyn Effect<S>,
        columns: &[Columns],
        overdispersion: &[f64],
    ) -> Vec<Vec<f64>> {
        let columns = self.by_signal(columns);
        let priors: Vec<f64> = effect
            .linear_parameters()
            .iter()
            .map(|l| l.prior_std)
            .collect();
        let sums = self.equations_by_signal(base, &columns, 1);
        match effect.scope() {
            Scope::PerSignal => sums
                .iter()
                .enumerate()
                .map(|(k, sums)| {
                    let Some(sums) = sums else { return Vec::new() };
                    let (gram, right) = sum_folds(sums);
                    let solution = solve_ridge(gram, &right, &self.ridge_with(base, k, &priors));
                    let first = base.columns[k].len();
                    (first..solution.nrows())
                        .map(|i| solution[(i, 0)])
                        .collect()
                })
                .collect(),
            Scope::Machine => {
                let (shared, _) = self.pooled_solution(base, &sums, &priors, overdispersion, None);
                let all: Vec<f64> = (0..priors.len()).map(|i| shared[(i, 0)]).collect();
                sums.iter()
                    .map(|s| s.as_ref().map_or(Vec::new(), |_| all.clone()))
                    .collect()
            }
        }
    }

    /// Columns of each signal; none where one is missing.
    fn by_signal<'a>(&self, columns: &'a [Columns]) -> Vec<Vec<&'a [f64]>> {
        (0..self.signals.len())
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
    fn equations_by_signal(
        &self,
        base: &BaseModel,
        columns: &[Vec<&[f64]>],
        rhs_count: usize,
    ) -> Vec<Option<NormalEquations>> {
        (columns.iter().enumerate())
            .map(|(k, own)| self.equations_of_signal(base, k, own, rhs_count))
            .collect()
    }

    fn equations_of_signal(
        &self,
        base: &BaseModel,
        k: usize,
        own: &[&[f64]],
        rhs_count: usize,
    ) -> Option<NormalEquations> {
        let acts_on = !own.is_empty() && self.signals[k].count > 0.0;
        acts_on.then(|| self.with_columns(base, k, own, rhs_count))
    }

    fn ridge_with(&self, base: &BaseModel, k: usize, priors: &[f64]) -> Vec<f64> {
        let mut ridge = self.ridge(k, &base.columns[k]);
        ridge.extend(priors.iter().map(|p| self.prior_scale(k) / (p * p)));
        ridge
    }

    fn own(
        &self,
        base: &BaseModel,
        sums: &[Option<NormalEquations>],
        priors: &[f64],
    ) -> Vec<Option<CrossValidated>> {
        sums.iter()
            .enumerate()
            .map(|(k, sums)| {
                sums.as_ref()
                    .map(|sums| cross_validate(sums, &self.ridge_with(base, k, priors)))
            })
            .collect()
    }
}

/// By which part the errors of the first right-hand side are larger than those of the others, the null samples.
fn excess(fitted: &CrossValidated) -> f64 {
    let null_samples = &fitted.sse[1..];
    let fault_free = null_samples.iter().sum::<f64>() / null_samples.len().max(1) as f64;
    fitted.sse[0] / fault_free.max(1e-300) - 1.0
}
