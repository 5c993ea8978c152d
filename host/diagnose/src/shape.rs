//! The shape of an effect: what it does not enter the residuals linearly with.

use super::columns::columns;
use super::effect::Effect;
use super::fit::{Base, Data};
use super::observed::Observed;
use super::trial::Trial;

/// The shape that explains most beside `base`, by a pattern search from that of `best`.
pub(super) fn best_shape<S: Observed>(
    data: &Data,
    base: &Base,
    sessions: &[S],
    effect: &dyn Effect<S>,
    mut best: Trial,
) -> Vec<f64> {
    const ROUNDS: usize = 5;
    best.score = f64::NEG_INFINITY;
    let overdispersion = best.overdispersion.clone();
    let evaluate = |shape: &[f64]| {
        let columns = columns(sessions, effect, shape, &[]);
        let base = &data.with_nuisances(base, sessions, effect, shape);
        data.trial(base, effect, shape, &columns, Some(&overdispersion))
    };
    for (j, parameter) in effect.shape().iter().enumerate() {
        let mut step = parameter.step;
        if step == 0.0 {
            continue;
        }
        if best.score == f64::NEG_INFINITY {
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
                if trial.score > best.score {
                    best = trial;
                    moved = true;
                    break;
                }
            }
            if !moved {
                step *= 0.4;
                rounds += 1;
            }
        }
    }
    best.shape
}
