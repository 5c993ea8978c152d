//! Counts how often the error of a load is within 1, 2 and 3 of its stated standard deviations, and
//! computes the RMS of error over standard deviation (1 where the stated one is right).

use serde::Serialize;

/// Counts of errors in standard deviations, of one load.
#[derive(Clone, Copy, Debug, Default)]
pub struct Band {
    samples: u64,
    inside: [u64; 3],
    /// Sum of `(error / sigma)^2`.
    squares: f64,
}

/// How a stated standard deviation sigma and the error go together.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct BandFigures {
    /// Valid samples with a reference within 1, 2 and 3 sigma [%]; 68.3, 95.4 and 99.7 where the error is
    /// normal with that standard deviation.
    pub inside_percent: [f64; 3],
    /// Root mean square of the error over sigma; 1 where sigma is right, above 1 where it is too small.
    pub error_over_sigma: f64,
}

impl Band {
    /// Takes the error of a valid sample and its stated standard deviation, both in the load's unit.
    pub fn push(&mut self, error: f64, sigma: f64) {
        let ratio = (error / sigma).abs();
        if ratio.is_finite() {
            self.samples += 1;
            self.squares += ratio * ratio;
            for (sigmas, count) in (1_u8..).zip(&mut self.inside) {
                *count += u64::from(ratio <= f64::from(sigmas));
            }
        }
    }

    /// Its figures; none without a valid sample that has a reference.
    pub fn figures(&self) -> Option<BandFigures> {
        let samples = self.samples as f64;
        (self.samples > 0).then(|| BandFigures {
            inside_percent: self.inside.map(|count| 100.0 * count as f64 / samples),
            error_over_sigma: (self.squares / samples).sqrt(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Errors of 0.5, -1.5, 2.5 and 4 standard deviations.
    #[test]
    fn worked_by_hand() {
        let mut band = Band::default();
        assert_eq!(band.figures(), None);
        for (error, sigma) in [(1.0, 2.0), (-3.0, 2.0), (2.5, 1.0), (4.0, 1.0), (1.0, 0.0)] {
            band.push(error, sigma);
        }
        let figures = band.figures().unwrap();
        assert_eq!(figures.inside_percent, [25.0, 50.0, 75.0]);
        assert!((figures.error_over_sigma - (24.75_f64 / 4.0).sqrt()).abs() < 1e-12);
    }
}
