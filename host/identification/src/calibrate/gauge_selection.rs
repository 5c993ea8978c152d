//! Selects gauges: finds the Pareto fronts of large response and small error, then chooses greedily
//! by the information that each adds over the carrier angle.

/// A gauge that could be used.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// Number of the channel in the machine.
    pub channel: usize,
    /// Magnitude of the sensitivity, `|f_T|` (reading in SI per unit sensed).
    pub response: f64,
    /// Mean absolute error of simulated against measured readings (SI).
    pub mae: f64,
    /// `m^2 / sigma^2` over the carrier angle, in as many bins for each gauge.
    pub information: Vec<f64>,
}

/// The number of the front on which each candidate lies, 0 for the Pareto front
/// of high response and low error, 1 for that of the others, and so on.
///
/// Source: Bosmans et al. 2023, section 6.1.
pub fn fronts(candidates: &[Candidate]) -> Vec<usize> {
    let mut front = vec![usize::MAX; candidates.len()];
    let dominates = |a: &Candidate, b: &Candidate| {
        a.response >= b.response && a.mae <= b.mae && (a.response > b.response || a.mae < b.mae)
    };
    for number in 0.. {
        let open: Vec<usize> = (0..front.len())
            .filter(|&i| front[i] == usize::MAX)
            .collect();
        if open.is_empty() {
            break;
        }
        let best = |i: usize| {
            !open
                .iter()
                .any(|&j| dominates(&candidates[j], &candidates[i]))
        };
        for i in open
            .iter()
            .copied()
            .filter(|&i| best(i))
            .collect::<Vec<_>>()
        {
            front[i] = number;
        }
    }
    front
}

/// Up to `count` of the candidates on the first `near` fronts (more where these
/// hold too few), in the order of their use: each one adds most to what the
/// ones before it say, as the mean over the carrier angle of the variance
/// `1 / (I_0 + sum I_i)`.
///
/// `I_0` is a hundredth of the largest mean information of one gauge: what the
/// filter still knows from the angles before.
pub fn select(candidates: &[Candidate], count: usize, near: usize) -> Vec<usize> {
    let front = fronts(candidates);
    let mut last = near;
    let on_fronts = |last: usize| {
        (0..front.len())
            .filter(|&i| front[i] < last)
            .collect::<Vec<_>>()
    };
    let mut open = on_fronts(last);
    while open.len() < count.min(candidates.len()) {
        last += 1;
        open = on_fronts(last);
    }
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len().max(1) as f64;
    let prior = 0.01
        * candidates
            .iter()
            .map(|c| mean(&c.information))
            .fold(0.0, f64::max);
    let bins = candidates.first().map_or(0, |c| c.information.len());
    let mut known = vec![prior; bins];
    let mut chosen = Vec::new();
    while chosen.len() < count {
        let variance = |i: usize| {
            let information = known.iter().zip(&candidates[i].information);
            information.map(|(a, b)| 1.0 / (a + b)).sum::<f64>()
        };
        let Some(best) = open
            .iter()
            .copied()
            .min_by(|a, b| variance(*a).total_cmp(&variance(*b)))
        else {
            break;
        };
        open.retain(|i| *i != best);
        for (known, more) in known.iter_mut().zip(&candidates[best].information) {
            *known += more;
        }
        chosen.push(best);
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    fn candidate(response: f64, mae: f64, information: &[f64]) -> Candidate {
        Candidate {
            channel: 0,
            response,
            mae,
            information: information.to_vec(),
        }
    }

    #[test]
    fn the_front_holds_what_nothing_beats_in_both() {
        let gauges = [
            candidate(3.0, 3.0, &[]),
            candidate(2.0, 1.0, &[]),
            candidate(2.0, 2.0, &[]),
            candidate(1.0, 4.0, &[]),
        ];
        assert_eq!(fronts(&gauges), [0, 0, 1, 2]);
    }

    #[test]
    fn the_second_gauge_sees_where_the_first_is_blind() {
        let gauges = [
            candidate(3.0, 1.0, &[10.0, 9.0, 0.0]),
            candidate(2.9, 0.9, &[10.0, 8.0, 0.0]),
            candidate(1.0, 0.8, &[0.0, 0.0, 3.0]),
        ];
        assert_eq!(select(&gauges, 2, 1), [0, 2]);
        assert_eq!(select(&gauges, 9, 1).len(), 3);
    }
}
