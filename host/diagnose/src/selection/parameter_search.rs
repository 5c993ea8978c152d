//! Searches the nonlinear parameters of one effect for the highest cross-validated evidence: one
//! after another by a pattern search from the best point of the grid, then several together by a
//! simplex search.

use crate::candidate_effect::{Effect, NonlinearParameter};
use crate::regression::cross_validation::{BaseModel, RegressionData};
use crate::regression::design_matrix::columns;
use crate::residual_model::ResidualModel;
use crate::selection::score::CandidateScore;
use crate::selection::simplex_search::{Point, maximise};

/// Times that the step of the search is made smaller.
const ROUNDS: usize = 5;

/// Factor on the step each time.
const SMALLER: f64 = 0.4;

/// Last step of the search about `value`: what explains most lies within half of it.
pub(crate) fn last_step(parameter: &NonlinearParameter, value: f64) -> f64 {
    let step = parameter.step * SMALLER.powi(ROUNDS as i32 - 1);
    if parameter.logarithmic {
        step * value.abs()
    } else {
        step
    }
}

/// The shape that explains most beside `base`: by a pattern search from that of `best`, then by a
/// simplex search where several parameters are searched.
pub(crate) fn search_parameters<S: ResidualModel>(
    data: &RegressionData,
    base: &BaseModel,
    recordings: &[S],
    effect: &dyn Effect<S>,
    mut best: CandidateScore,
) -> Vec<f64> {
    best.log_evidence = f64::NEG_INFINITY;
    let overdispersion = best.overdispersion.clone();
    let evaluate = |shape: &[f64]| {
        let columns = columns(recordings, effect, shape, &[]);
        let base = &data.with_nuisances(base, recordings, effect, shape);
        data.trial(base, effect, shape, &columns, Some(&overdispersion))
    };
    for (j, parameter) in effect.nonlinear_parameters().iter().enumerate() {
        let mut step = parameter.step;
        if step == 0.0 {
            continue;
        }
        if best.log_evidence == f64::NEG_INFINITY {
            best = evaluate(&best.shape);
        }
        let mut rounds = 0;
        while rounds < ROUNDS {
            let mut moved = false;
            for sign in [1.0, -1.0] {
                let mut shape = best.shape.clone();
                shape[j] = if parameter.logarithmic {
                    shape[j] * (sign * step).exp()
                } else {
                    shape[j] + sign * step
                }
                .clamp(parameter.bounds.0, parameter.bounds.1);
                let trial = evaluate(&shape);
                if trial.log_evidence > best.log_evidence {
                    best = trial;
                    moved = true;
                    break;
                }
            }
            if !moved {
                step *= SMALLER;
                rounds += 1;
            }
        }
    }
    searched_together(effect.nonlinear_parameters(), best, evaluate)
}

/// The shape of the highest evidence near `best`, all parameters that are searched together; that
/// of `best` where they are fewer than two.
fn searched_together(
    parameters: &[NonlinearParameter],
    best: CandidateScore,
    evaluate: impl Fn(&[f64]) -> CandidateScore,
) -> Vec<f64> {
    let free: Vec<usize> = (0..parameters.len())
        .filter(|j| parameters[*j].step > 0.0)
        .collect();
    if free.len() < 2 {
        return best.shape;
    }
    // Logarithms where a parameter is searched by factors.
    let coordinate = |j: usize, value: f64| {
        if parameters[j].logarithmic {
            value.ln()
        } else {
            value
        }
    };
    let start = best.shape.clone();
    let shape_at = |at: &[f64]| {
        let mut shape = start.clone();
        for (&j, &x) in free.iter().zip(at) {
            let value = if parameters[j].logarithmic {
                x.exp()
            } else {
                x
            };
            shape[j] = value.clamp(parameters[j].bounds.0, parameters[j].bounds.1);
        }
        shape
    };
    let steps = |round: usize| -> Vec<f64> {
        let smaller = SMALLER.powi(round as i32);
        free.iter().map(|j| parameters[*j].step * smaller).collect()
    };
    let point = |trial: CandidateScore| Point {
        at: (free.iter().map(|&j| coordinate(j, trial.shape[j]))).collect(),
        value: trial.log_evidence,
        found: trial.shape,
    };
    let found = maximise(point(best), &steps(0), &steps(ROUNDS - 1), |at| {
        point(evaluate(&shape_at(at)))
    });
    found.found
}
