//! Minimises a function of a few parameters from a start, without gradients, by pattern search
//! (Hooke and Jeeves, exploratory moves).

use rayon::prelude::*;

/// Minimises `f` from `start` by looking one `step` either way along each
/// axis, moving to the best neighbour, and halving the step where none is
/// better, down to `least_step`; every coordinate stays within `reach` of its
/// start. The best point and its value.
///
/// Source: Hooke and Jeeves 1961, exploratory moves only; named in Bosmans et
/// al. 2023, section 5.3.3.
pub fn pattern_search(
    start: &[f64],
    mut step: f64,
    least_step: f64,
    reach: f64,
    f: impl Fn(&[f64]) -> f64 + Sync,
) -> (Vec<f64>, f64) {
    let mut best = (start.to_vec(), f(start));
    while step >= least_step {
        let neighbours: Vec<Vec<f64>> = (0..start.len())
            .flat_map(|i| [-step, step].map(|by| (i, by)))
            .filter(|(i, by)| (best.0[*i] + by - start[*i]).abs() <= reach)
            .map(|(i, by)| {
                let mut point = best.0.clone();
                point[i] += by;
                point
            })
            .collect();
        let found = neighbours
            .into_par_iter()
            .map(|point| {
                let value = f(&point);
                (point, value)
            })
            .min_by(|a, b| a.1.total_cmp(&b.1));
        match found {
            Some(found) if found.1 < best.1 => best = found,
            _ => step *= 0.5,
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_value_is_found_inside_and_at_the_edge() {
        let bowl = |x: &[f64]| (x[0] - 1.3).powi(2) + 10.0 * (x[1] + 2.0 + 0.3 * x[0]).powi(2);
        let (point, value) = pattern_search(&[0.0, 0.0], 1.0, 1e-3, 9.0, bowl);
        assert!(
            (point[0] - 1.3).abs() < 0.01 && value < 1e-3,
            "{point:?} {value}"
        );
        let (point, _) = pattern_search(&[0.0], 0.5, 0.1, 2.0, |x| -x[0]);
        assert_eq!(point, [2.0]);
    }
}
