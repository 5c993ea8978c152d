//! Fits the parameters of a drivetrain to residuals (`Posterior`): maximum of the posterior by Gauss-Newton
//! steps with the damping of Levenberg and Marquardt, and its covariance.

use std::collections::BTreeMap;

use faer::Mat;
use rayon::prelude::*;

use super::data_part::DataPart;
use super::parameter::Quantity;
use crate::regression::normal_equations::{dot, solve_ridge};

/// Farthest stiffness from which the search starts, in standard deviations.
const FARTHEST: f64 = 3.0;

/// Distance of the stiffnesses from which it starts, relative: about the width of the resonance of a shaft
/// with 1 % of critical damping, so that one of them vibrates in step with the recording.
const START_STEP: f64 = 0.02;

/// Difference over which the residuals are differentiated, in standard deviations of the description.
const DIFFERENCE: f64 = 0.02;

/// Most steps of a descent.
const STEPS: usize = 12;

/// Gain in twice the log-posterior below which a descent ends.
const LEAST_GAIN: f64 = 0.05;

/// Descents, each with the weights that the residuals before it give.
const DESCENTS: usize = 3;

/// Parameters that are most probable after a fit, in standard deviations of the description from the
/// described values.
pub(super) struct Posterior {
    /// The parameters.
    pub offsets: Vec<f64>,
    /// Their covariance.
    pub covariance: Mat<f64>,
    /// Independent samples of each stretch.
    pub samples: Vec<f64>,
}

impl Posterior {
    /// Standard deviation of parameter `i`, over that of the description, at most 1.
    pub fn std(&self, i: usize) -> f64 {
        self.covariance[(i, i)].sqrt().min(1.0)
    }

    /// Fits the parameters of `data`.
    ///
    /// Minimises `sum_k n_k ln(r_k' r_k) + |z|^2` over the offsets `z`, with the residual `r_k` of
    /// stretch `k` beside its nuisance columns and its independent samples `n_k`: a normal
    /// likelihood of unknown variance, and the description as prior. With `w_k = n_k / r_k' r_k` the covariance is
    /// `C = (I + sum_k w_k X_k' X_k)^-1`, `X = -dr/dz`: samples that are alike count once.
    ///
    /// Each variance has the square of the error of a chain of lumped inertias added
    /// ([`Parameter::model_std`](super::parameter::Parameter::model_std)).
    ///
    /// Sensors that contradict each other widen it. Each of `m` groups of sensors, with the score
    /// `g = sum_k w_k X_k' r_k` and the covariance `C_g` of its own, would move the parameters by `d_g = C_g g`. Where
    /// that is beyond chance, `q = g' C_g g` above the mean of its chi-squared distribution by two deviations,
    /// `(1 - p / q) d_g d_g' / m` is added, with `p` parameters: the covariance between groups by the method of
    /// moments. Gauges that contradict each other in how two inertias share a sum leave the sum as it is.
    ///
    /// Sources: Marquardt 1963 (damping); R. `DerSimonian` and N. Laird 1986, "Meta-analysis in clinical trials" (variance
    /// between groups).
    pub fn fit(data: &DataPart<'_>, progress: impl Fn(f64)) -> Self {
        let mut search = Search::new(data, vec![0.0; data.parameters.len()]);
        search.scan();
        search.descended(progress)
    }

    /// The same, the search beginning where `self` is.
    pub fn continued(&self, data: &DataPart<'_>, progress: impl Fn(f64)) -> Self {
        Search::new(data, self.offsets.clone()).descended(progress)
    }
}

/// A point of the search.
struct Search<'a> {
    data: &'a DataPart<'a>,
    offsets: Vec<f64>,
    residuals: Vec<Vec<f64>>,
    /// Independent samples of each stretch, where the search began.
    samples: Vec<f64>,
    cost: f64,
}

impl<'a> Search<'a> {
    fn new(data: &'a DataPart<'a>, offsets: Vec<f64>) -> Self {
        let residuals = data.residuals(&offsets);
        let pairs = data.stretches.iter().zip(&residuals);
        let mut search = Self {
            data,
            samples: pairs.map(|(s, r)| s.independent_samples(r)).collect(),
            cost: 0.0,
            residuals,
            offsets,
        };
        search.cost = search.cost_of(&search.offsets, &search.residuals);
        search
    }

    /// Twice the negative logarithm of the posterior.
    fn cost_of(&self, offsets: &[f64], residuals: &[Vec<f64>]) -> f64 {
        let misfit = residuals.iter().zip(&self.samples);
        let misfit = misfit.map(|(r, n)| n * dot(r, r).max(f64::MIN_POSITIVE).ln());
        misfit.sum::<f64>() + dot(offsets, offsets)
    }

    /// Goes to `offsets` where these are more probable.
    fn try_at(&mut self, offsets: Vec<f64>) -> bool {
        let residuals = self.data.residuals(&offsets);
        let cost = self.cost_of(&offsets, &residuals);
        let is_better = cost < self.cost;
        if is_better {
            (self.offsets, self.residuals, self.cost) = (offsets, residuals, cost);
        }
        is_better
    }

    /// Tries a grid over one stiffness after another: far from the right one a vibration is out of step,
    /// and no gradient leads there.
    fn scan(&mut self) {
        for (i, parameter) in self.data.parameters.iter().enumerate() {
            let step = START_STEP * parameter.described / parameter.prior_std;
            let most = (FARTHEST / step) as i32;
            if parameter.quantity != Quantity::Stiffness || most > 100 {
                continue;
            }
            let from = self.offsets.clone();
            for number in (-most..=most).filter(|number| *number != 0) {
                let mut at = from.clone();
                at[i] += f64::from(number) * step;
                self.try_at(at);
            }
        }
    }

    /// `1 / variance` of a sample of each stretch, over the samples that are alike.
    fn weights(&self) -> Vec<f64> {
        let pairs = self.residuals.iter().zip(&self.samples);
        pairs
            .map(|(r, n)| n / dot(r, r).max(f64::MIN_POSITIVE))
            .collect()
    }

    /// `-dr/dz`: `[parameter][stretch][sample]`.
    fn columns(&self) -> Vec<Vec<Vec<f64>>> {
        let column = |i: usize| {
            let mut at = self.offsets.clone();
            at[i] += DIFFERENCE;
            let mut changed = self.data.residuals(&at);
            for (changed, here) in changed.iter_mut().zip(&self.residuals) {
                for (c, h) in changed.iter_mut().zip(here) {
                    *c = (h - *c) / DIFFERENCE;
                }
            }
            changed
        };
        (0..self.offsets.len())
            .into_par_iter()
            .map(column)
            .collect()
    }

    /// Score `X_k' r_k` and information `X_k' X_k` of stretch `k`, weighted.
    fn moments(
        columns: &[Vec<Vec<f64>>],
        k: usize,
        r: &[f64],
        weight: f64,
    ) -> (Mat<f64>, Mat<f64>) {
        let p = columns.len();
        (
            Mat::from_fn(p, 1, |a, _| weight * dot(&columns[a][k], r)),
            Mat::from_fn(p, p, |a, b| weight * dot(&columns[a][k], &columns[b][k])),
        )
    }

    /// The posterior, after descents that each have the weights of the residuals before it.
    fn descended(mut self, progress: impl Fn(f64)) -> Posterior {
        for descent in 0..DESCENTS {
            self.descend();
            self = Search::new(self.data, self.offsets);
            progress((descent + 1) as f64 / DESCENTS as f64);
        }
        self.posterior()
    }

    fn descend(&mut self) {
        let p = self.offsets.len();
        let mut damping = 1e-3;
        for _ in 0..STEPS {
            let (columns, weights) = (self.columns(), self.weights());
            let mut information = Mat::<f64>::identity(p, p);
            let mut score = Mat::from_fn(p, 1, |a, _| -self.offsets[a]);
            for (k, r) in self.residuals.iter().enumerate() {
                let (own_score, own) = Self::moments(&columns, k, r, weights[k]);
                information += own;
                score += own_score;
            }
            let before = self.cost;
            for _ in 0..6 {
                let ridge: Vec<f64> = (0..p).map(|a| damping * information[(a, a)]).collect();
                let step = solve_ridge(information.clone(), &score, &ridge);
                let next = (self.data.parameters.iter().enumerate())
                    .map(|(a, parameter)| {
                        (self.offsets[a] + step[(a, 0)]).max(parameter.least_offset())
                    })
                    .collect();
                if self.try_at(next) {
                    damping *= 0.1;
                    break;
                }
                damping *= 10.0;
            }
            if before - self.cost < LEAST_GAIN {
                break;
            }
        }
    }

    fn posterior(self) -> Posterior {
        let p = self.offsets.len();
        let (columns, weights) = (self.columns(), self.weights());
        let mut information = Mat::<f64>::identity(p, p);
        let mut groups: BTreeMap<String, (Mat<f64>, Mat<f64>)> = BTreeMap::new();
        for (k, stretch) in self.data.stretches.iter().enumerate() {
            let (score, own) = Self::moments(&columns, k, &self.residuals[k], weights[k]);
            information += &own;
            let group = self.data.sensor(stretch).group();
            let empty = || (Mat::zeros(p, 1), Mat::identity(p, p));
            let sums = groups.entry(group).or_insert_with(empty);
            sums.0 += score;
            sums.1 += own;
        }
        let identity = Mat::<f64>::identity(p, p);
        let covariance = solve_ridge(information, &identity, &[]);
        let (count, most) = (p as f64, p as f64 + 2.0 * (2.0 * p as f64).sqrt());
        let mut wider = covariance.clone();
        for (i, parameter) in self.data.parameters.iter().enumerate() {
            wider[(i, i)] += (parameter.model_std() / parameter.prior_std).powi(2);
        }
        let share = 1.0 / groups.len().max(1) as f64;
        for (score, information) in groups.into_values() {
            let moved = solve_ridge(information, &score, &[]);
            let q = (score.transpose() * &moved)[(0, 0)];
            if q > most {
                let part = share * (1.0 - count / q);
                wider += Mat::from_fn(p, p, |a, b| part * moved[(a, 0)] * moved[(b, 0)]);
            }
        }
        Posterior {
            covariance: wider,
            offsets: self.offsets,
            samples: self.samples,
        }
    }
}
