//! Computes the correlation of an innovation sequence with an input 1 to 25 samples earlier, sample
//! by sample, with the bound that 95 % of the coefficients of independent signals keep.

use super::LAGS;

/// 97.5 % quantile of the standard normal distribution.
const Z_95: f64 = 1.959_963_984_540_054;

/// Correlation of an output with an input 1 to [`LAGS`] samples before, in one pass.
///
/// `r_k = cov(y_t, u_{t-k}) / sqrt(var(y) var(u))`, both over the pairs of that lag
///
/// A value that is not finite takes its place in time but is part of no pair.
#[derive(Clone, Debug)]
pub struct CrossCorrelation {
    /// First finite values: subtracted before summing, so that large means cost no digits.
    origins: [Option<f64>; 2],
    /// The last inputs less their origin, newest first; NaN where none.
    inputs: [f64; LAGS],
    sums: [Sums; LAGS],
}

#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    pairs: f64,
    y: f64,
    u: f64,
    yy: f64,
    uu: f64,
    yu: f64,
}

impl Default for CrossCorrelation {
    fn default() -> Self {
        Self {
            origins: [None; 2],
            inputs: [f64::NAN; LAGS],
            sums: [Sums::default(); LAGS],
        }
    }
}

impl CrossCorrelation {
    /// Takes the next output and the input at the same sample.
    pub fn push(&mut self, output: f64, input: f64) {
        if output.is_finite() {
            let y = output - *self.origins[0].get_or_insert(output);
            for (sums, u) in self.sums.iter_mut().zip(self.inputs) {
                if u.is_finite() {
                    sums.pairs += 1.0;
                    sums.y += y;
                    sums.u += u;
                    sums.yy += y * y;
                    sums.uu += u * u;
                    sums.yu += y * u;
                }
            }
        }
        self.inputs.rotate_right(1);
        self.inputs[0] = if input.is_finite() {
            input - *self.origins[1].get_or_insert(input)
        } else {
            f64::NAN
        };
    }

    /// `r_1` to `r_25`; `None` for a lag without pairs or signals that do not vary.
    pub fn coefficients(&self) -> [Option<f64>; LAGS] {
        self.sums.map(|s| {
            let n = s.pairs;
            let [y, u] = [s.yy - s.y * s.y / n, s.uu - s.u * s.u / n];
            let r = (s.yu - s.y * s.u / n) / (y * u).sqrt();
            (y > 1e-12 * s.yy && u > 1e-12 * s.uu && r.is_finite()).then_some(r)
        })
    }

    /// Bound `1.96 / sqrt(n)` that 95 % of the coefficients of a white output stay within, whatever
    /// the input is, where the two have nothing in common.
    pub fn bound(&self) -> f64 {
        Z_95 / self.sums[0].pairs.sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `y_t = u_{t-3} + e_t` with parts of equal variance: 1/sqrt(2) at lag 3, nothing elsewhere; a
    /// gap shifts nothing.
    #[test]
    fn a_delayed_input_is_found_at_its_lag() {
        let mut state = 7_u32;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(state >> 8)
        };
        let inputs: Vec<f64> = (0..20_000).map(|_| 1e9 + noise()).collect();
        let mut found = CrossCorrelation::default();
        for t in 0..inputs.len() {
            let y = if t < 3 || t == 5000 {
                f64::NAN
            } else {
                inputs[t - 3] + noise()
            };
            let u = if t == 9000 { f64::INFINITY } else { inputs[t] };
            found.push(y, u);
        }
        let r = found.coefficients().map(Option::unwrap);
        assert!((r[2] - 0.5_f64.sqrt()).abs() < 0.01, "{r:?}");
        let others = (0..LAGS).filter(|k| *k != 2 && r[*k].abs() > found.bound());
        assert!(others.count() <= 4, "{r:?}");
        assert!((found.bound() - 1.96 / 20_000_f64.sqrt()).abs() < 1e-5);
    }

    #[test]
    fn a_constant_has_none() {
        let mut found = CrossCorrelation::default();
        (0..100).for_each(|t| found.push(f64::from(t), 3.5));
        assert_eq!(found.coefficients(), [None; LAGS]);
    }
}
