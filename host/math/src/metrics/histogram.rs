//! Counts values, such as normalised innovations, in bins of equal width over a fixed range, sample
//! by sample, and gives their probability density.

/// Counts in bins of equal width over `low <= x < high`, and how many lie outside.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    low: f64,
    width: f64,
    counts: Vec<u64>,
    /// Values below the range.
    pub below: u64,
    /// Values at or above the end of the range.
    pub above: u64,
}

impl Histogram {
    /// `bins` empty bins from `low` to `high`.
    ///
    /// # Panics
    /// Unless `low < high`, both finite, and `bins > 0`: the range is the caller's constant.
    pub fn new(low: f64, high: f64, bins: usize) -> Self {
        assert!(low < high && (high - low).is_finite() && bins > 0);
        Self {
            low,
            width: (high - low) / bins as f64,
            counts: vec![0; bins],
            below: 0,
            above: 0,
        }
    }

    /// Counts one value; one that is not a number is passed over.
    pub fn push(&mut self, value: f64) {
        let place = (value - self.low) / self.width;
        if place.is_nan() {
            return;
        }
        if place < 0.0 {
            self.below += 1;
        } else if let Some(count) = self.counts.get_mut(place as usize) {
            *count += 1;
        } else {
            self.above += 1;
        }
    }

    /// All values counted, those outside included.
    pub fn samples(&self) -> u64 {
        self.below + self.above + self.counts.iter().sum::<u64>()
    }

    /// Centre of each bin and its probability density, `count / (samples width)`.
    pub fn density(&self) -> impl Iterator<Item = (f64, f64)> {
        let scale = 1.0 / (self.samples().max(1) as f64 * self.width);
        self.counts.iter().enumerate().map(move |(i, &count)| {
            (
                self.low + (i as f64 + 0.5) * self.width,
                count as f64 * scale,
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_by_hand() {
        let mut histogram = Histogram::new(-1.0, 1.0, 4);
        for value in [
            -1.0,
            -0.6,
            -0.1,
            0.0,
            0.49,
            1.0,
            f64::NAN,
            f64::INFINITY,
            -1.1,
        ] {
            histogram.push(value);
        }
        assert_eq!(
            (histogram.below, histogram.above, histogram.samples()),
            (1, 2, 8)
        );
        let density: Vec<_> = histogram.density().collect();
        // 2, 1, 2, 0 of 8 in bins of 0.5.
        assert_eq!(
            density,
            [(-0.75, 0.5), (-0.25, 0.25), (0.25, 0.5), (0.75, 0.0)]
        );
    }
}
