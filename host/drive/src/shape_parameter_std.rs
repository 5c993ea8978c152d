//! Standard deviations of the shape parameters of the effects found: linearised least squares
//! (Gauss-Newton), with the resolution of the search added.

use faer::Mat;
use faer::linalg::solvers::DenseSolveCore;

use crate::design_matrix;
use crate::design_matrix::Dataset;
use crate::least_squares::Columns;
use crate::smoothed_motion::Motion;
use crate::stepwise::{FINEST_STEP, LEAST_FALL, Selection};

/// Step of the numerical derivative, in parts of the parameter.
const STEP: f64 = 0.02;

/// Standard deviation of each number of each part's shape; none of those that are not refined.
///
/// `P = s2 ([X D]' [X D] + Lambda)^-1`: columns `X` of all parts, derivatives `D` of what they contribute after each
/// refined number, `s2` the variance of the residual times its correlation time, priors `Lambda` of the columns
/// (Gauss-Newton). To this adds the resolution of the search.
///
/// Source: Seber, Wild 1989, Nonlinear Regression, eq. (2.20).
pub(crate) fn shape_stds(
    selection: &Selection<'_>,
    motions: &[Motion],
    table: &Dataset,
) -> Vec<Vec<Option<f64>>> {
    let columns = selection.columns(None);
    let fitted = selection.fitted();
    let mut places = Vec::new();
    let mut derivatives = Vec::new();
    let mut first = selection.base().len();
    for (k, part) in selection.parts.iter().enumerate() {
        let coefficients = &fitted.coefficients[first..first + part.columns.len()];
        first += part.columns.len();
        let contribution = |shape: &[f64]| {
            let mut of_part = Columns::default();
            let values = design_matrix::columns(motions, part.effect, shape);
            of_part.push(&values, &part.prior);
            of_part.times(coefficients, table.len())
        };
        for &i in part.effect.refined() {
            let value = part.shape[i];
            if value == 0.0 {
                continue;
            }
            let moved = |factor: f64| {
                let mut shape = part.shape.clone();
                shape[i] *= factor;
                contribution(&shape)
            };
            let (above, below) = (moved(1.0 + STEP), moved(1.0 - STEP));
            let slope = (above.iter().zip(&below)).map(|(a, b)| (a - b) / (2.0 * STEP * value));
            derivatives.push(slope.collect::<Vec<f64>>());
            places.push((k, i));
        }
    }
    let variances = variances(&columns, &derivatives, table, selection.noise_variance());
    // A fall of the sum of squares that the search passes over, in variances of the parameter.
    let passed_over = LEAST_FALL * fitted.squares / selection.noise_variance();
    let mut stds: Vec<Vec<Option<f64>>> = (selection.parts.iter())
        .map(|part| vec![None; part.shape.len()])
        .collect();
    for ((k, i), variance) in places.into_iter().zip(variances) {
        let step = FINEST_STEP * selection.parts[k].shape[i];
        let std = (variance * (1.0 + passed_over) + step * step).sqrt();
        stds[k][i] = Some(std).filter(|std| std.is_finite());
    }
    stds
}

/// Variances of the parameters that `derivatives` belong to.
fn variances(
    columns: &Columns,
    derivatives: &[Vec<f64>],
    table: &Dataset,
    noise_variance: f64,
) -> Vec<f64> {
    let n = table.len() as f64;
    let mean_square = table.drive.iter().map(|d| d * d).sum::<f64>() / n;
    let linear = columns
        .with_priors()
        .map(|(values, prior)| (values, Some(prior)));
    let all: Vec<(&Vec<f64>, Option<f64>)> = linear
        .chain(derivatives.iter().map(|d| (d, None)))
        .collect();
    let scale: Vec<f64> = (all.iter())
        .map(|(x, _)| {
            (x.iter().map(|x| x * x).sum::<f64>() / n)
                .sqrt()
                .max(f64::MIN_POSITIVE)
        })
        .collect();
    let information = Mat::from_fn(all.len(), all.len(), |a, b| {
        let products = all[a].0.iter().zip(all[b].0).map(|(x, y)| x * y);
        let sum = products.sum::<f64>() / (scale[a] * scale[b]);
        match all[a].1 {
            Some(prior) if a == b => {
                sum + noise_variance / (prior * prior * mean_square).max(f64::MIN_POSITIVE)
            }
            _ => sum,
        }
    });
    let covariance = information.partial_piv_lu().inverse();
    (columns.len()..all.len())
        .map(|k| noise_variance * covariance[(k, k)] / (scale[k] * scale[k]))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::candidate_effect::{Effect, Scale};
    use crate::least_squares::shared;
    use crate::stepwise::LINEAR_PRIOR;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    const ROWS: usize = 1000;
    const DT_S: f64 = 0.02;

    /// Reversals of several lengths with an effect of `shape`, and noise whose neighbours correlate by 0.5.
    fn recording(effect: &dyn Effect, shape: &[f64], seed: u64) -> Motion {
        let mut noise = ChaCha8Rng::seed_from_u64(seed);
        let t: Vec<f64> = (0..ROWS).map(|i| DT_S * i as f64).collect();
        let waves = [(1.0, 0.9), (0.4, 2.3), (0.15, 5.1)];
        let of = |f: fn(f64, f64, f64) -> f64| -> Vec<f64> {
            t.iter()
                .map(|t| waves.iter().map(|(a, w)| f(*a, *w, *t)).sum())
                .collect()
        };
        let position = of(|a, w, t| a * (w * t).sin());
        let speed = of(|a, w, t| a * w * (w * t).cos());
        let acceleration = of(|a, w, t| -a * w * w * (w * t).sin());
        let still = Motion::moving(
            t.clone(),
            [
                position.clone(),
                speed.clone(),
                acceleration.clone(),
                vec![0.0; ROWS],
            ],
        );
        let column = effect.columns(&still, shape).remove(0);
        let mut last = 0.0;
        let drive = (0..ROWS)
            .map(|i| {
                // Of variance 1 / 3 each.
                last = 0.5 * last + 0.05 * noise.random_range(-1.0..1.0);
                0.1 + 0.02 * acceleration[i] + 0.03 * speed[i] + 0.5 * column[i] + last
            })
            .collect();
        Motion::moving(t, [position, speed, acceleration, drive])
    }

    /// Of how many recordings the true number lies within two standard deviations, and of how many it was found.
    fn coverage(name: &str, shape: &[f64], number: usize) -> (usize, usize) {
        let effect = crate::find(name).unwrap();
        let errors: Vec<f64> = (0..30)
            .filter_map(|seed| {
                let motions = [recording(effect, shape, seed)];
                let table = Dataset::new(&motions);
                let linear = design_matrix::linear(&motions);
                let mut base = Columns::default();
                base.push(&linear, &shared(linear.len(), LINEAR_PRIOR));
                let found =
                    Selection::find(&motions, &table, base, &Scale::new(&motions, 10.0), |_| ());
                let stds = shape_stds(&found, &motions, &table);
                let [part] = &found.parts[..] else {
                    return None;
                };
                let std = stds[0][number]?;
                (part.effect.name() == name).then(|| (part.shape[number] - shape[number]) / std)
            })
            .collect();
        println!("{name}: {errors:.1?}");
        (
            errors.iter().filter(|e| e.abs() <= 2.0).count(),
            errors.len(),
        )
    }

    #[test]
    fn the_true_shape_lies_within_two_standard_deviations() {
        for (name, shape) in [("presliding-hysteresis", 0.2), ("backlash", 0.15)] {
            let (inside, found) = coverage(name, &[shape], 0);
            assert!(found >= 20, "{name}: found in {found} of 30");
            assert!(100 * inside >= 85 * found, "{name}: {inside} of {found}");
        }
    }
}
