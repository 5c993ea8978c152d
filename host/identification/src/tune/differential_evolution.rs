//! Minimises a function over a box, without gradients or a start, by differential evolution (Storn
//! and Price, DE/rand/1/bin).

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

/// How far a trial goes along the difference of two others, `F` of the source.
const WEIGHT: f64 = 0.7;

/// Part of the coordinates that a trial takes from there, `CR` of the source.
const CROSSOVER: f64 = 0.9;

/// How large a population is and how long it lives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evolution {
    /// Points that live at once, at least 4.
    pub population: usize,
    /// Times that each is tried to be replaced.
    pub generations: usize,
    /// Draws points and trials; the result depends on nothing else.
    pub seed: u64,
}

impl Evolution {
    /// Minimises `f` over the box `bounds`, lowest and highest of each coordinate; `known`
    /// points live from the beginning. The best point and its value.
    ///
    /// `v = a + WEIGHT (b - c)` of three others, which may coincide, crossed with the point, takes its
    /// place where it is not worse; a generation is tried in parallel.
    ///
    /// Source: Storn, Price, Differential evolution, J. Global Optim. 11 (1997), DE/rand/1/bin.
    pub fn minimise(
        &self,
        bounds: &[(f64, f64)],
        known: &[Vec<f64>],
        f: impl Fn(&[f64]) -> f64 + Sync,
    ) -> (Vec<f64>, f64) {
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed);
        let size = self.population.max(4);
        let valued = |points: Vec<Vec<f64>>| -> Vec<(Vec<f64>, f64)> {
            let values: Vec<f64> = points.par_iter().map(|point| f(point)).collect();
            points.into_iter().zip(values).collect()
        };
        let mut first = known.to_vec();
        first.resize_with(size.max(known.len()), || {
            (bounds.iter())
                .map(|(low, high)| low + (high - low) * rng.random::<f64>())
                .collect()
        });
        let mut living = valued(first);
        for _ in 0..self.generations {
            let trials = (0..living.len())
                .map(|i| {
                    let mut other = || loop {
                        let k = rng.random_range(0..living.len());
                        if k != i {
                            return &living[k].0;
                        }
                    };
                    let (a, b, c) = (other(), other(), other());
                    let certain = rng.random_range(0..bounds.len());
                    (bounds.iter().enumerate())
                        .map(|(j, (low, high))| {
                            if j == certain || rng.random::<f64>() < CROSSOVER {
                                (a[j] + WEIGHT * (b[j] - c[j])).clamp(*low, *high)
                            } else {
                                living[i].0[j]
                            }
                        })
                        .collect()
                })
                .collect();
            for (old, new) in living.iter_mut().zip(valued(trials)) {
                if new.1 <= old.1 {
                    *old = new;
                }
            }
        }
        (living.into_iter())
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap_or((Vec::new(), f64::INFINITY))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_of_many_valleys_is_found_and_found_again() {
        // Rastrigin's function: 121 minima in the box, 0 at (1, -2).
        let rastrigin = |x: &[f64]| -> f64 {
            [x[0] - 1.0, x[1] + 2.0]
                .map(|d| d * d + 10.0 * (1.0 - (std::f64::consts::TAU * d).cos()))
                .iter()
                .sum()
        };
        let evolution = Evolution {
            population: 30,
            generations: 120,
            seed: 7,
        };
        let run = || evolution.minimise(&[(-5.0, 5.0); 2], &[vec![4.0, 4.0]], rastrigin);
        let (point, value) = run();
        assert!(value < 1e-6, "{point:?} {value}");
        assert_eq!(run().0, point);
    }
}
