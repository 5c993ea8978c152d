//! Student's t: two-sided quantile and probability.

use special::Beta;

/// What Student's t is beyond, on either side, with the probability `outside`, 0 to 1.
///
/// `freedom`: degrees of freedom, > 0.
pub fn student_quantile(freedom: f64, outside: f64) -> f64 {
    let (a, b) = (0.5 * freedom, 0.5);
    let x = outside.inv_inc_beta(a, b, a.ln_beta(b));
    (freedom * (1.0 - x) / x).sqrt()
}

/// Probability that Student's t is beyond `t`, on either side.
///
/// `freedom`: degrees of freedom, > 0.
pub fn student_both_tails(t: f64, freedom: f64) -> f64 {
    let (a, b) = (0.5 * freedom, 0.5);
    (freedom / (freedom + t * t)).inc_beta(a, b, a.ln_beta(b))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tables: 5 % beyond 12.706, 2.365 and 1.962; 1 % beyond 3.250.
    #[test]
    fn quantiles_and_tails_equal_tables() {
        for (freedom, outside, t) in [
            (1.0, 0.05, 12.706),
            (7.0, 0.05, 2.365),
            (1000.0, 0.05, 1.962),
            (9.0, 0.01, 3.250),
        ] {
            let found = student_quantile(freedom, outside);
            assert!((found - t).abs() < 1e-3, "{found}");
            let back = student_both_tails(t, freedom);
            assert!((back / outside - 1.0).abs() < 2e-3, "{back}");
        }
    }
}
