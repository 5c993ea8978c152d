//! Plateaus of a recorded load: stretches in which it is held, by a hidden Markov model of
//! its increments with two states, hold and motion.

use std::ops::Range;

use super::candidate_term::SAME_LOAD;

/// Iterations of the estimation; the states are far apart, and it ends long before.
const ITERATIONS: usize = 40;

/// Least standard deviation of an increment, in parts of the range of the load: rounding.
const ROUNDING: f64 = 1e-9;

/// Fewest values of a plateau: four pieces of four, whose scatter gives its standard error.
pub(super) const FEWEST: usize = 16;

/// Standard deviations by which plateaus in a row have to differ; the same load otherwise, with a
/// disturbance in it.
const DIFFERENT: f64 = 4.0;

/// The plateaus of `load`, in order.
///
/// Increments are normal, with zero mean and one variance for each of the states hold and motion.
/// Variances and transition probabilities are found by expectation and maximisation, the states by
/// the most probable path. A value belongs to a plateau if the increments on both sides of it are
/// those of hold. A load that always moves has states of slow and fast motion: a stretch over which
/// it changes by more than [`SAME_LOAD`] is none.
///
/// Source: Rabiner 1989, A tutorial on hidden Markov models, section III.
pub(super) fn plateaus(load: &[f64]) -> Vec<Range<usize>> {
    let steps: Vec<f64> = load.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let (low, high) = (load.iter()).fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
        (low.min(*x), high.max(*x))
    });
    if steps.is_empty() || high <= low {
        return std::iter::once(0..load.len())
            .filter(|all| all.len() >= FEWEST)
            .collect();
    }
    let moving = States::found(&steps, (ROUNDING * (high - low)).powi(2)).path(&steps);
    let mut found: Vec<Range<usize>> = Vec::new();
    let mut from = 0;
    for (i, moves) in moving.iter().chain([&true]).enumerate() {
        if *moves {
            // The value beside a motion may be a mean over part of it.
            let first = if from == 0 { 0 } else { from + 1 };
            let last = if i == moving.len() { i + 1 } else { i };
            if first + FEWEST <= last {
                join(&mut found, first..last, load);
            }
            from = i + 1;
        }
    }
    found.retain(|range| spread(&load[range.clone()]) <= SAME_LOAD * (high - low));
    found
}

/// Puts the line between its neighbours into each gap of `load` that is shorter than a plateau.
///
/// # Errors
/// Where a gap begins that is as long as a plateau.
pub(super) fn fill_gaps(load: &mut [f64]) -> Result<(), usize> {
    let mut from = 0;
    while let Some(first) = (from..load.len()).find(|&i| !load[i].is_finite()) {
        let end = (first..load.len()).find(|&i| load[i].is_finite());
        let length = end.unwrap_or(load.len()) - first;
        let before = first.checked_sub(1).map(|i| load[i]);
        let Some((a, b)) = (before.or(end.map(|i| load[i]))).zip(end.map(|i| load[i]).or(before))
        else {
            return Err(first);
        };
        if length >= FEWEST {
            return Err(first);
        }
        for k in 0..length {
            let part = (k + 1) as f64 / (length + 1) as f64;
            load[first + k] = a + part * (b - a);
        }
        from = first + length;
    }
    Ok(())
}

/// Difference of the largest and the smallest mean over sixteenths of a plateau.
fn spread(load: &[f64]) -> f64 {
    let part = load.len() / FEWEST;
    let means = || {
        load.chunks_exact(part)
            .map(|chunk| chunk.iter().sum::<f64>() / part as f64)
    };
    means().fold(f64::NEG_INFINITY, f64::max) - means().fold(f64::INFINITY, f64::min)
}

/// Adds a plateau, or makes the last one longer where the load came back to it.
fn join(found: &mut Vec<Range<usize>>, next: Range<usize>, load: &[f64]) {
    let moments = |range: &Range<usize>| {
        let values = &load[range.clone()];
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / n;
        (mean, variance)
    };
    if let Some(last) = found.last_mut() {
        let ((a, va), (b, vb)) = (moments(last), moments(&next));
        if (a - b).abs() <= DIFFERENT * (va + vb).sqrt() {
            // The longer of the two, so that the disturbance between them is left out.
            if next.len() > last.len() {
                *last = next;
            }
            return;
        }
    }
    found.push(next);
}

/// Hidden Markov model of the increments: state 0 holds, state 1 moves.
struct States {
    variance: [f64; 2],
    /// Probability of the other state next.
    leaves: [f64; 2],
}

impl States {
    fn found(steps: &[f64], least: f64) -> Self {
        let mut sizes: Vec<f64> = steps.iter().map(|d| d * d).collect();
        sizes.sort_by(f64::total_cmp);
        let mean = sizes.iter().sum::<f64>() / sizes.len() as f64;
        let mut states = Self {
            variance: [sizes[sizes.len() / 2].max(least), mean.max(4.0 * least)],
            leaves: [0.01, 0.1],
        };
        for _ in 0..ITERATIONS {
            states.improve(steps, least);
        }
        states
    }

    fn density(&self, d: f64) -> [f64; 2] {
        // A state that cannot be still has a probability, so that the sums are not 0.
        self.variance
            .map(|v| ((-0.5 * d * d / v).exp() / v.sqrt()).max(f64::MIN_POSITIVE))
    }

    /// One step of expectation and maximisation.
    fn improve(&mut self, steps: &[f64], least: f64) {
        let n = steps.len();
        let stays = self.leaves.map(|p| 1.0 - p);
        let densities: Vec<[f64; 2]> = steps.iter().map(|d| self.density(*d)).collect();
        let next = |a: [f64; 2]| {
            [
                a[0] * stays[0] + a[1] * self.leaves[1],
                a[0] * self.leaves[0] + a[1] * stays[1],
            ]
        };
        let mut forward = Vec::with_capacity(n);
        let mut before = [0.5, 0.5];
        for density in &densities {
            before = normalised([before[0] * density[0], before[1] * density[1]]);
            forward.push(before);
            before = next(before);
        }
        let (mut squares, mut weight) = ([0.0; 2], [0.0; 2]);
        let (mut left, mut seen) = ([0.0; 2], [0.0; 2]);
        let mut backward = [1.0, 1.0];
        for i in (0..n).rev() {
            let here = normalised([0, 1].map(|s| forward[i][s] * backward[s]));
            for s in 0..2 {
                squares[s] += here[s] * steps[i] * steps[i];
                weight[s] += here[s];
            }
            if i > 0 {
                let after = [0, 1].map(|s| densities[i][s] * backward[s]);
                let joint = [
                    [
                        forward[i - 1][0] * stays[0] * after[0],
                        forward[i - 1][0] * self.leaves[0] * after[1],
                    ],
                    [
                        forward[i - 1][1] * self.leaves[1] * after[0],
                        forward[i - 1][1] * stays[1] * after[1],
                    ],
                ];
                let total: f64 = joint.iter().flatten().sum();
                for s in 0..2 {
                    left[s] += joint[s][1 - s] / total;
                    seen[s] += (joint[s][0] + joint[s][1]) / total;
                }
                backward = normalised([
                    stays[0] * after[0] + self.leaves[0] * after[1],
                    self.leaves[1] * after[0] + stays[1] * after[1],
                ]);
            }
        }
        for s in 0..2 {
            self.variance[s] = (squares[s] / weight[s].max(f64::MIN_POSITIVE)).max(least);
            // One change more than counted, so that none becomes impossible.
            self.leaves[s] = ((left[s] + 1.0) / (seen[s] + 2.0)).clamp(1e-9, 0.5);
        }
        if self.variance[0] > self.variance[1] {
            self.variance.swap(0, 1);
            self.leaves.swap(0, 1);
        }
    }

    /// Whether each increment is one of motion, on the most probable path.
    fn path(&self, steps: &[f64]) -> Vec<bool> {
        let mut from = Vec::with_capacity(steps.len());
        let mut score = [0.0; 2];
        for d in steps {
            let density = self.variance.map(|v| -0.5 * (d * d / v + v.ln()));
            let step = |s: usize| {
                let stay = score[s] + (1.0 - self.leaves[s]).ln();
                let come = score[1 - s] + self.leaves[1 - s].ln();
                if stay >= come {
                    (stay, s)
                } else {
                    (come, 1 - s)
                }
            };
            let (hold, motion) = (step(0), step(1));
            from.push([hold.1, motion.1]);
            score = [hold.0 + density[0], motion.0 + density[1]];
        }
        let mut state = usize::from(score[1] > score[0]);
        let mut path: Vec<bool> = from
            .iter()
            .rev()
            .map(|from| {
                let here = state == 1;
                state = from[state];
                here
            })
            .collect();
        path.reverse();
        path
    }
}

fn normalised(a: [f64; 2]) -> [f64; 2] {
    let sum = (a[0] + a[1]).max(f64::MIN_POSITIVE);
    a.map(|x| x / sum)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;

    /// Five loads of 200 values with ramps of 20 between them, in noise of a fifth of a step of a
    /// ramp and without any: each plateau is found, and no value of a ramp is in one.
    #[test]
    fn plateaus_between_ramps() {
        for noise in [0.0, 0.1] {
            let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
            let mut load = Vec::new();
            for k in 0..5 {
                let level = 10.0 * f64::from(k);
                load.extend((0..200).map(|_| level));
                load.extend((1..20).map(|j| level + 0.5 * f64::from(j)));
            }
            for x in &mut load {
                *x += noise * rng.sample::<f64, _>(StandardNormal);
            }
            let found = plateaus(&load);
            assert_eq!(found.len(), 5, "{found:?}");
            for (k, range) in found.iter().enumerate() {
                let is = 219 * k..219 * k + 200;
                assert!(
                    range.start >= is.start && range.end <= is.end + 1,
                    "{range:?} in {is:?}"
                );
                assert!(range.len() > 180, "{range:?}");
            }
        }
    }

    #[test]
    fn a_load_that_always_moves_has_no_plateau() {
        let sine: Vec<f64> = (0..3000).map(|i| (f64::from(i) / 300.0).sin()).collect();
        assert_eq!(plateaus(&sine), Vec::new());
        let ramp: Vec<f64> = (0..3000).map(f64::from).collect();
        assert_eq!(plateaus(&ramp), Vec::new());
    }
}
