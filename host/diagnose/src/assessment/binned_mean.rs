//! Bins a residual over a measured quantity into 24 bins of equal count, and computes its mean in
//! each bin and the part of its variance that these means explain, by two-fold cross-validation
//! over blocks. The residual tests and the empirical corrections use it.

/// Number of bins.
const BINS: usize = 24;

/// Bin of a sample, and in which half of the blocks it lies.
pub(crate) type BinRange = (usize, usize);

/// A sample in its bin: `(bin, y, half)`.
pub(crate) type Binned = (usize, f64, usize);

/// `x` where both are known.
pub(crate) fn known<'a>(x: &'a [f64], y: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
    let pairs = x.iter().zip(y);
    let known = pairs.filter(|(x, y)| x.is_finite() && y.is_finite());
    known.map(|(x, _)| *x)
}

/// `y` in its `bins_of`, where both are known.
pub(crate) fn binned<'a>(
    bins_of: &'a [Option<BinRange>],
    y: &'a [f64],
) -> impl Iterator<Item = Binned> + 'a {
    let known = bins_of.iter().zip(y).filter(|(_, y)| y.is_finite());
    known.filter_map(|(place, y)| place.map(|(bin, half)| (bin, *y, half)))
}

/// Bins with as many samples each.
pub(crate) struct Bins {
    /// Upper ends of all but the last.
    ends: Vec<f64>,
    /// Middles of the bins, rising.
    pub middles: Vec<f64>,
}

impl Bins {
    /// Of `values`; none where they are too few or all the same.
    pub fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let mut values: Vec<f64> = values.collect();
        values.sort_by(f64::total_cmp);
        let n = values.len();
        if n < 4 * BINS || values[n / 20] == values[n - 1 - n / 20] {
            return None;
        }
        let at = |twice: usize| values[(twice * n / (2 * BINS)).min(n - 1)];
        Some(Self {
            ends: (1..BINS).map(|b| at(2 * b)).collect(),
            middles: (0..BINS).map(|b| at(2 * b + 1)).collect(),
        })
    }

    /// Where each of `x` is, if known; blocks of `block` samples are dealt to the halves in turn.
    pub fn bins_of(&self, x: &[f64], block: usize) -> Vec<Option<BinRange>> {
        let bin = |x: f64| self.ends.partition_point(|end| *end < x);
        let place = |(i, x): (usize, &f64)| x.is_finite().then(|| (bin(*x), i / block % 2));
        x.iter().enumerate().map(place).collect()
    }
}

/// Mean of `(bin, y)` in each bin about the mean of all; 0 where there is none.
pub(crate) fn means(samples: impl Iterator<Item = (usize, f64)>) -> Vec<f64> {
    let (mut sums, mut counts) = (vec![0.0; BINS], vec![0.0_f64; BINS]);
    for (bin, y) in samples {
        sums[bin] += y;
        counts[bin] += 1.0;
    }
    let mean = sums.iter().sum::<f64>() / counts.iter().sum::<f64>().max(1.0);
    (sums.iter().zip(&counts))
        .map(|(sum, n)| if *n > 0.0 { sum / n - mean } else { 0.0 })
        .collect()
}

/// Part of the mean square about the mean that the means of every other block take from the
/// rest.
pub(crate) fn explained_by_bins(samples: &[Binned]) -> f64 {
    let (mut left, mut whole) = (0.0, 0.0);
    for half in 0..2 {
        let of = |half: usize| (samples.iter()).filter(move |s| s.2 == half);
        let means = means(of(1 - half).map(|s| (s.0, s.1)));
        let n = of(half).count().max(1) as f64;
        let mean = of(half).map(|s| s.1).sum::<f64>() / n;
        for (bin, y, _) in of(half) {
            whole += (y - mean).powi(2);
            left += (y - mean - means[*bin]).powi(2);
        }
    }
    1.0 - left / f64::max(whole, 1e-300)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// x goes round, y is `of` x and noise.
    fn samples(of: impl Fn(f64) -> f64) -> (Vec<f64>, Vec<f64>) {
        let mut noise = 1_u32;
        (0..20_000)
            .map(|i| {
                noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let x = f64::from(i) * 0.037 % std::f64::consts::TAU;
                let white = f64::from(noise) / f64::from(u32::MAX) - 0.5;
                (x, of(x) + 0.1 * white)
            })
            .unzip()
    }

    /// In blocks of 100 samples.
    fn in_bins((x, y): &(Vec<f64>, Vec<f64>)) -> (Bins, Vec<Binned>) {
        let bins = Bins::of(known(x, y)).unwrap();
        let samples = binned(&bins.bins_of(x, 100), y).collect();
        (bins, samples)
    }

    #[test]
    fn what_goes_with_a_quantity_is_taken_and_noise_is_not() {
        let (bins, wave) = in_bins(&samples(f64::sin));
        assert!(explained_by_bins(&wave) > 0.95);
        let means = means(wave.iter().map(|s| (s.0, s.1)));
        for (x, mean) in bins.middles.iter().zip(means) {
            assert!((mean - x.sin()).abs() < 0.05, "{x} {mean}");
        }
        let (_, noise) = in_bins(&samples(|_| 0.0));
        assert!(explained_by_bins(&noise) < 0.01);
    }

    #[test]
    fn a_constant_quantity_has_no_bins() {
        let (x, _) = samples(f64::sin);
        assert!(Bins::of(x.iter().map(|_| 1.0)).is_none());
    }
}
