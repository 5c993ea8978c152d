//! Maximises a function of two or more parameters by the simplex search of Nelder and Mead
//! (`maximise`): along a ridge, where a search of one parameter after another stops short. Needs no
//! derivative, so that kinks do not stop it.

/// Moves of a corner for each parameter at most: in two dimensions a simplex needs some 30 for each
/// to shrink to a hundredth.
const MOVES: usize = 40;

/// Place of a reflected corner on the line from the worst corner (-1) through the centre of the
/// others (0).
const REFLECTED: f64 = 1.0;

/// The same, expanded.
const EXPANDED: f64 = 2.0;

/// The same, contracted beyond the centre.
const OUTSIDE: f64 = 0.5;

/// The same, contracted before the centre.
const INSIDE: f64 = -OUTSIDE;

/// Part of the distance to the best corner that is left when the simplex shrinks.
const SHRUNK: f64 = 0.5;

/// A point with its value.
pub(super) struct Point<T> {
    pub at: Vec<f64>,
    pub value: f64,
    /// What was computed there.
    pub found: T,
}

/// The highest point found from `start`, with a first simplex of `size` in each coordinate (upwards,
/// or downwards where `evaluate` holds the coordinate at a bound), until its corners lie within
/// `resolution` of each other.
///
/// Source: Nelder, Mead 1965, A simplex method for function minimization; factors of Lagarias et
/// al. 1998.
pub(super) fn maximise<T>(
    start: Point<T>,
    size: &[f64],
    resolution: &[f64],
    evaluate: impl Fn(&[f64]) -> Point<T>,
) -> Point<T> {
    let n = start.at.len();
    let evaluate = |at: &[f64]| {
        let mut point = evaluate(at);
        if point.value.is_nan() {
            point.value = f64::NEG_INFINITY;
        }
        point
    };
    let beside = |j: usize| {
        let mut at = start.at.clone();
        at[j] += size[j];
        let above = evaluate(&at);
        if above.at[j] > start.at[j] {
            return above;
        }
        at[j] = start.at[j] - size[j];
        evaluate(&at)
    };
    let mut corners: Vec<Point<T>> = (0..n).map(beside).collect();
    corners.push(start);
    for _ in 0..n * MOVES {
        corners.sort_by(|a, b| b.value.total_cmp(&a.value));
        let is_small = (0..n).all(|j| {
            let off = |corner: &Point<T>| (corner.at[j] - corners[0].at[j]).abs();
            corners.iter().map(off).fold(0.0, f64::max) < resolution[j]
        });
        if is_small {
            break;
        }
        let centre: Vec<f64> = (0..n)
            .map(|j| corners[..n].iter().map(|corner| corner.at[j]).sum::<f64>() / n as f64)
            .collect();
        let worst = &corners[n];
        let along = |factor: f64| {
            let pairs = centre.iter().zip(&worst.at);
            let at: Vec<f64> = pairs.map(|(c, w)| c + factor * (c - w)).collect();
            evaluate(&at)
        };
        let reflected = along(REFLECTED);
        let better = if reflected.value > corners[0].value {
            let expanded = along(EXPANDED);
            Some(if expanded.value > reflected.value {
                expanded
            } else {
                reflected
            })
        } else if reflected.value > corners[n - 1].value {
            Some(reflected)
        } else {
            let (factor, least) = if reflected.value > worst.value {
                (OUTSIDE, reflected.value)
            } else {
                (INSIDE, worst.value)
            };
            Some(along(factor)).filter(|contracted| contracted.value >= least)
        };
        if let Some(point) = better {
            corners[n] = point;
            continue;
        }
        let best = corners[0].at.clone();
        for corner in &mut corners[1..] {
            let pairs = corner.at.iter().zip(&best);
            let at: Vec<f64> = pairs.map(|(x, b)| b + SHRUNK * (x - b)).collect();
            *corner = evaluate(&at);
        }
    }
    // Not empty: it has the start.
    corners.sort_by(|a, b| b.value.total_cmp(&a.value));
    corners.swap_remove(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_narrow_ridge_with_a_kink_is_followed_to_its_top() {
        let count = std::cell::Cell::new(0);
        // Correlation 0.98, and a fold across the ridge: one coordinate after another stops at once.
        let evaluate = |at: &[f64]| {
            count.set(count.get() + 1);
            let (x, y) = (at[0] - 0.7, at[1] + 0.4);
            let value = -(x * x + y * y - 2.0 * 0.98 * x * y) - 0.01 * (x + 0.3).abs();
            Point {
                at: at.to_vec(),
                value,
                found: (),
            }
        };
        let start = evaluate(&[0.0, -1.1]);
        let found = maximise(start, &[0.15, 0.15], &[4e-3, 4e-3], evaluate);
        // Where the fold shifts it to: x = y = -0.01 / (4 (1 - 0.98)).
        assert!((found.at[0] - 0.575).abs() < 0.03, "{:?}", found.at);
        assert!((found.at[1] + 0.525).abs() < 0.03, "{:?}", found.at);
        assert!(count.get() < 90, "{}", count.get());
    }

    #[test]
    fn a_start_at_a_bound_goes_down_from_it() {
        let evaluate = |at: &[f64]| {
            let at: Vec<f64> = at.iter().map(|x| x.min(1.0)).collect();
            Point {
                value: -(at[0] - 0.6).powi(2) - (at[1] - 0.9).powi(2),
                at,
                found: (),
            }
        };
        let found = maximise(evaluate(&[1.0, 1.0]), &[0.1, 0.1], &[1e-3, 1e-3], evaluate);
        assert!((found.at[0] - 0.6).abs() < 0.01, "{:?}", found.at);
        assert!((found.at[1] - 0.9).abs() < 0.01, "{:?}", found.at);
    }

    #[test]
    fn the_start_stays_where_nothing_is_higher() {
        let evaluate = |at: &[f64]| Point {
            at: at.to_vec(),
            value: -at[0].abs() - at[1].abs(),
            found: (),
        };
        let found = maximise(evaluate(&[0.0, 0.0]), &[1.0, 1.0], &[1e-2, 1e-2], evaluate);
        assert_eq!(found.at, [0.0, 0.0]);
    }
}
