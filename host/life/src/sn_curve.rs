//! S-N curves: cycles to failure over the range of a load cycle, with a choice of slope below the
//! last point.

use crate::LifeError;
use crate::error::positive;

/// What holds beyond the last point of a curve.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Beyond {
    /// The last slope `m` continues (elementary Miner).
    Elementary,
    /// The slope is `2 m - 1` (Haibach 1970).
    Haibach,
    /// Smaller ranges do no damage.
    CutOff,
}

/// Cycles to failure over range: straight lines in logarithms of both.
///
/// `N = N_i (S_i / S)^m_i`, with `m_i = ln(N_i+1 / N_i) / ln(S_i / S_i+1)`
/// between the points i and i + 1; above the first point its slope continues.
#[derive(Clone, Debug, PartialEq)]
pub struct SnCurve {
    /// Cycles, range.
    points: Vec<(f64, f64)>,
    beyond: Beyond,
}

impl SnCurve {
    /// A curve through points of cycles and range [unit of the load]: two for
    /// one slope, three for two.
    ///
    /// # Errors
    /// When there are fewer than two points, when a number is not positive,
    /// or when the range does not fall with the cycles.
    pub fn through(points: &[(f64, f64)], beyond: Beyond) -> Result<Self, LifeError> {
        if points.len() < 2 {
            return Err(LifeError::FewPoints(points.len()));
        }
        for &(cycles, range) in points {
            positive("cycles of the S-N curve", cycles)?;
            positive("range of the S-N curve", range)?;
        }
        for pair in points.windows(2) {
            let [(cycles_before, range_before), (cycles, range)] = [pair[0], pair[1]];
            if cycles <= cycles_before || range >= range_before {
                return Err(LifeError::Rises {
                    cycles_before,
                    range_before,
                    cycles,
                    range,
                });
            }
        }
        Ok(Self {
            points: points.to_vec(),
            beyond,
        })
    }

    /// A curve of slope `exponent` that ends at `cycles` and `range`.
    ///
    /// # Errors
    /// When a number is not positive.
    pub fn with_slope(
        exponent: f64,
        cycles: f64,
        range: f64,
        beyond: Beyond,
    ) -> Result<Self, LifeError> {
        let exponent = positive("exponent", exponent)?;
        let (cycles, range) = (
            positive("cycles of the S-N curve", cycles)?,
            positive("range of the S-N curve", range)?,
        );
        let first = (cycles * 2.0_f64.powf(-exponent), 2.0 * range);
        Self::through(&[first, (cycles, range)], beyond)
    }

    /// Cycles to failure at a range; none where it does no damage.
    pub fn cycles_to_failure(&self, range: f64) -> Option<f64> {
        let last = self.points.len() - 1;
        let (last_cycles, last_range) = self.points[last];
        if range <= 0.0 {
            return None;
        }
        if range < last_range {
            let slope = self.slope(last - 1);
            let slope = match self.beyond {
                Beyond::Elementary => slope,
                Beyond::Haibach => 2.0 * slope - 1.0,
                Beyond::CutOff => return None,
            };
            return Some(last_cycles * (last_range / range).powf(slope));
        }
        // The piece that ends at or below the range.
        let piece = (0..last)
            .find(|&i| self.points[i + 1].1 <= range)
            .unwrap_or(last - 1);
        let (cycles, at) = self.points[piece];
        Some(cycles * (at / range).powf(self.slope(piece)))
    }

    fn slope(&self, piece: usize) -> f64 {
        let ((n1, s1), (n2, s2)) = (self.points[piece], self.points[piece + 1]);
        (n2 / n1).ln() / (s1 / s2).ln()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(found: Option<f64>, expected: f64) -> bool {
        found.is_some_and(|found| (found / expected - 1.0).abs() < 1e-12)
    }

    #[test]
    fn one_slope_and_what_is_beyond_its_end() {
        let curve = |beyond| SnCurve::with_slope(3.0, 2e6, 90.0, beyond).unwrap();
        let haibach = curve(Beyond::Haibach);
        assert!(close(haibach.cycles_to_failure(90.0), 2e6));
        assert!(close(haibach.cycles_to_failure(180.0), 2.5e5));
        assert!(close(haibach.cycles_to_failure(900.0), 2e3));
        assert!(close(haibach.cycles_to_failure(45.0), 2e6 * 32.0));
        assert!(close(
            curve(Beyond::Elementary).cycles_to_failure(45.0),
            1.6e7
        ));
        assert_eq!(curve(Beyond::CutOff).cycles_to_failure(89.9), None);
        assert_eq!(haibach.cycles_to_failure(0.0), None);
    }

    /// EN 1993-1-9, category 90: slope 3 to 5e6 cycles, 5 to 1e8, cut off there.
    #[test]
    fn two_slopes_with_cut_off() {
        let constant = 90.0 * (2.0_f64 / 5.0).powf(1.0 / 3.0);
        let cut_off = constant * (5.0_f64 / 100.0).powf(0.2);
        let points = [(2e6, 90.0), (5e6, constant), (1e8, cut_off)];
        let curve = SnCurve::through(&points, Beyond::CutOff).unwrap();
        assert!(close(curve.cycles_to_failure(180.0), 2.5e5));
        assert!(close(curve.cycles_to_failure(constant), 5e6));
        assert!(close(
            curve.cycles_to_failure(50.0),
            5e6 * (constant / 50.0).powi(5)
        ));
        assert_eq!(curve.cycles_to_failure(0.999 * cut_off), None);
    }

    #[test]
    fn curves_that_rise_are_refused() {
        let rises = SnCurve::through(&[(1e6, 50.0), (2e6, 60.0)], Beyond::CutOff);
        let error = rises.unwrap_err().to_string();
        assert!(
            error.contains("2e6 cycles at range 60 after 1e6 cycles at range 50"),
            "{error}"
        );
        for points in [
            &[][..],
            &[(1.0, 1.0)],
            &[(1e3, 5.0), (1e3, 4.0)],
            &[(0.0, 5.0), (1.0, 4.0)],
        ] {
            assert!(SnCurve::through(points, Beyond::Elementary).is_err());
        }
        for exponent in [0.0, -3.0, f64::NAN] {
            assert!(SnCurve::with_slope(exponent, 1e6, 50.0, Beyond::Haibach).is_err());
        }
    }
}
