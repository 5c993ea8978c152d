//! All parameters together, and what they leave of the residuals.

use super::columns::{base_columns, columns, joined};
use super::effect::Coupling;
use super::observed::Observed;
use super::select::{Found, RELINEARISED};
use super::stream::Columns;
use super::sums::{mirror, solved};

/// Evidence that a stream must give for an effect with parameters of its own
/// to be taken to act on it.
const ACTS: f64 = 4.0;

/// Fits all parameters together: nuisances of each stream and effects in
/// turn, until they agree.
#[allow(
    clippy::too_many_lines,
    reason = "the two halves of a step share all that they change"
)]
pub(super) fn refit<S: Observed>(
    sessions: &[S],
    found: &mut [Found<S>],
    newest: Option<&[f64]>,
) -> Vec<Vec<f64>> {
    const ROUNDS: usize = 25;
    let streams = sessions[0].streams().len();
    let base = base_columns(sessions, &[]);
    let residuals: Vec<Vec<f64>> = (0..streams)
        .map(|k| joined(sessions, |s| s.residual(k).to_vec()))
        .collect();
    if let (Some(gains), Some(last)) = (newest, found.last_mut()) {
        // Which streams the newest one acts on.
        let least = ACTS.max(0.005 * gains.iter().copied().fold(0.0, f64::max));
        last.parameters = (0..streams)
            .map(|k| {
                let acts = last.effect.coupling() == Coupling::Shared || gains[k] > least;
                vec![0.0; if acts { last.effect.linear().len() } else { 0 }]
            })
            .collect();
    }
    let weight: Vec<f64> = (0..streams)
        .map(|k| sessions[0].noise_std(k).powi(-2))
        .collect();
    let subtract = |rest: &mut [f64], column: &[f64], by: f64| {
        for (r, c) in rest.iter_mut().zip(column) {
            *r -= by * c;
        }
    };
    let turns = if found.iter().all(|f| f.effect.is_linear()) {
        1
    } else {
        RELINEARISED
    };
    let mut nuisance = Vec::new();
    for _ in 0..turns {
        let all: Vec<Vec<Columns>> = found
            .iter()
            .map(|f| columns(sessions, f.effect, &f.shape, &f.parameters))
            .collect();
        let mut rest = residuals.clone();
        nuisance = base.iter().map(|b| vec![0.0; b.len()]).collect();
        for f in found.iter_mut() {
            for parameters in &mut f.parameters {
                parameters.fill(0.0);
            }
        }
        for _ in 0..ROUNDS {
            for k in 0..streams {
                // Nuisances and the stream's own parameters together.
                let mut own: Vec<(&[f64], f64)> = base[k]
                    .iter()
                    .map(|p| (p.column.as_slice(), p.std))
                    .collect();
                for (f, columns) in found.iter().zip(&all) {
                    if f.effect.coupling() == Coupling::Own && !f.parameters[k].is_empty() {
                        for (linear, c) in f.effect.linear().iter().zip(columns) {
                            if !c[k].is_empty() {
                                own.push((&c[k], linear.prior_std));
                            }
                        }
                    }
                }
                let step = least_squares(
                    &own,
                    &rest[k],
                    weight[k],
                    &current(&nuisance[k], found, &all, k),
                );
                for ((column, _), by) in own.iter().zip(&step) {
                    subtract(&mut rest[k], column, *by);
                }
                let mut steps = step.into_iter();
                for value in &mut nuisance[k] {
                    *value += steps.next().unwrap_or(0.0);
                }
                for (f, columns) in found.iter_mut().zip(&all) {
                    if f.effect.coupling() == Coupling::Own && !columns[0][k].is_empty() {
                        for value in &mut f.parameters[k] {
                            *value += steps.next().unwrap_or(0.0);
                        }
                    }
                }
            }
            for (f, columns) in found.iter_mut().zip(&all) {
                if f.effect.coupling() == Coupling::Shared {
                    shared_step(f, columns, &mut rest, &weight);
                }
            }
        }
    }
    nuisance
}

/// Parameters of stream `k` as they stand, in the order of its columns.
fn current<S: Observed>(
    nuisance: &[f64],
    found: &[Found<S>],
    all: &[Vec<Columns>],
    k: usize,
) -> Vec<f64> {
    let own = found
        .iter()
        .zip(all)
        .filter(|(f, c)| f.effect.coupling() == Coupling::Own && !c[0][k].is_empty())
        .flat_map(|(f, _)| f.parameters[k].iter().copied());
    nuisance.iter().copied().chain(own).collect()
}

/// Step towards the minimum of `weight |rest - columns step|^2 + |(now + step)/std|^2`.
fn least_squares(columns: &[(&[f64], f64)], rest: &[f64], weight: f64, now: &[f64]) -> Vec<f64> {
    let p = columns.len();
    let mut gram = faer::Mat::<f64>::zeros(p, p);
    let mut right = faer::Mat::<f64>::zeros(p, 1);
    for (i, r) in rest.iter().enumerate().filter(|(_, r)| r.is_finite()) {
        for (a, (x, _)) in columns.iter().enumerate() {
            right[(a, 0)] += weight * x[i] * r;
            for (b, (y, _)) in columns[..=a].iter().enumerate() {
                gram[(a, b)] += weight * x[i] * y[i];
            }
        }
    }
    mirror(&mut gram);
    let ridge: Vec<f64> = columns.iter().map(|(_, std)| 1.0 / (std * std)).collect();
    for (a, ridge) in ridge.iter().enumerate() {
        right[(a, 0)] -= ridge * now.get(a).copied().unwrap_or(0.0);
    }
    let step = solved(gram, &right, &ridge);
    (0..p).map(|a| step[(a, 0)]).collect()
}

fn shared_step<S: Observed>(
    f: &mut Found<S>,
    columns: &[Columns],
    rest: &mut [Vec<f64>],
    weight: &[f64],
) {
    let c = columns.len();
    let mut gram = faer::Mat::<f64>::zeros(c, c);
    let mut right = faer::Mat::<f64>::zeros(c, 1);
    for (k, rest) in rest.iter().enumerate() {
        if columns.iter().any(|x| x[k].is_empty()) {
            continue;
        }
        for (i, r) in rest.iter().enumerate().filter(|(_, r)| r.is_finite()) {
            for a in 0..c {
                right[(a, 0)] += weight[k] * columns[a][k][i] * r;
                for b in 0..=a {
                    gram[(a, b)] += weight[k] * columns[a][k][i] * columns[b][k][i];
                }
            }
        }
    }
    mirror(&mut gram);
    let step = solved(gram, &right, &vec![0.0; c]);
    for (k, rest) in rest.iter_mut().enumerate() {
        if columns.iter().any(|x| x[k].is_empty()) {
            f.parameters[k].clear();
            continue;
        }
        for a in 0..c {
            f.parameters[k][a] += step[(a, 0)];
            for (r, x) in rest.iter_mut().zip(&columns[a][k]) {
                *r -= step[(a, 0)] * x;
            }
        }
    }
}

/// Residuals of `sessions` less nuisances and effects: `[session][stream]`.
pub(super) fn rest<S: Observed>(
    sessions: &[S],
    found: &[Found<S>],
    nuisance: &[Vec<f64>],
) -> Vec<Vec<Vec<f64>>> {
    sessions
        .iter()
        .map(|session| {
            let one = std::slice::from_ref(session);
            let base = base_columns(one, &[]);
            let all: Vec<Vec<Columns>> = found
                .iter()
                .map(|f| columns(one, f.effect, &f.shape, &f.parameters))
                .collect();
            (0..session.streams().len())
                .map(|k| {
                    let mut rest = session.residual(k).to_vec();
                    let mut subtract = |column: &[f64], by: f64| {
                        for (r, c) in rest.iter_mut().zip(column) {
                            *r -= by * c;
                        }
                    };
                    for (prior, value) in base[k].iter().zip(&nuisance[k]) {
                        subtract(&prior.column, *value);
                    }
                    for (f, columns) in found.iter().zip(&all) {
                        for (column, value) in columns.iter().zip(&f.parameters[k]) {
                            subtract(&column[k], *value);
                        }
                    }
                    rest
                })
                .collect()
        })
        .collect()
}
