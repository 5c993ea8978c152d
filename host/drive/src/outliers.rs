//! Removes outliers from a sampled signal: single values far from the median of their neighbours
//! become NaN (Hampel filter).

/// Distance from the median, in ranges of the neighbours or usual distances, from which a value is
/// an outlier.
const FAR: f64 = 10.0;

/// Values on either side that a value is compared with.
const BESIDE: usize = 2;

/// Replaces by NaN what jumps out alone, and returns how many values that were.
///
/// `|x_i - m| > 10 max(q, r)`, with `m` the median of two values on either side and
/// `r` their range, so that neither a step nor a sharp turn is one; `q` is the 99th
/// percentile of the left side over the signal, so that neither is what often jumps,
/// or the signal's resolution where that is more.
///
/// Source: Hampel 1974, The influence curve and its role in robust estimation.
pub fn remove(x: &mut [f64]) -> usize {
    let off: Vec<(f64, f64)> = (0..x.len()).map(|i| beside(x, i)).collect();
    let mut sorted: Vec<f64> = off.iter().map(|o| o.0).filter(|d| d.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let Some(usual) = sorted.get(sorted.len() * 99 / 100) else {
        return 0;
    };
    let resolution = x
        .windows(2)
        .map(|pair| (pair[1] - pair[0]).abs())
        .filter(|d| *d > 0.0)
        .min_by(f64::total_cmp)
        .unwrap_or(0.0);
    let bound = usual.max(resolution);
    let mut count = 0;
    for (x, (off, range)) in x.iter_mut().zip(&off) {
        if *off > FAR * bound.max(*range) {
            *x = f64::NAN;
            count += 1;
        }
    }
    count
}

/// Distance of a value from the median of those beside it, and their range.
fn beside(x: &[f64], i: usize) -> (f64, f64) {
    let from = i.saturating_sub(BESIDE);
    let to = (i + BESIDE + 1).min(x.len());
    let mut near: Vec<f64> = (from..to)
        .filter(|&k| k != i && x[k].is_finite())
        .map(|k| x[k])
        .collect();
    near.sort_by(f64::total_cmp);
    match near[..] {
        [] => (0.0, 0.0),
        [first, .., last] => ((x[i] - near[near.len() / 2]).abs(), last - first),
        [only] => ((x[i] - only).abs(), 0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A step, counts of an encoder and noise stay; what jumps out goes.
    #[test]
    fn only_what_jumps_alone_goes() {
        let mut x: Vec<f64> = (0..1000)
            .map(|i| f64::from(i * 7919 % 101) * 0.01 + if i < 500 { 0.0 } else { 300.0 })
            .collect();
        assert_eq!(remove(&mut x), 0);
        x[200] = 1e6;
        x[700] = f64::NAN;
        assert_eq!(remove(&mut x), 1);
        assert!(x[200].is_nan() && x[199].is_finite() && x[500].is_finite());
        let mut counts: Vec<f64> = (0..1000).map(|i| f64::from(i / 300)).collect();
        counts[50] = 1.0;
        assert_eq!(remove(&mut counts), 0);
    }
}
