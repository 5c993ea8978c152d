//! Equivalent torque of a gear: the power mean over the revolutions of its shaft at each
//! torque.

use crate::LifeError;
use crate::error::positive;

/// Constant torque that does the same damage to a gear in the same turns:
/// `T_eq = (sum n_i |T_i|^p / sum n_i)^(1/p)`; none without turns.
///
/// `turns`: torque (N m) and turns `n_i` at it, of the shaft of the gear; each
/// tooth is loaded once a turn and mesh. Torques of both signs count on the
/// flank that they load, here as one.
///
/// # Errors
/// [`LifeError::Number`] when `exponent` is not above zero.
///
/// Source: ISO 6336-6:2019, equation (A.1); p is the slope of the damage line of table A.1.
pub fn equivalent_torque(turns: &[(f64, f64)], exponent: f64) -> Result<Option<f64>, LifeError> {
    positive("exponent of the gear", exponent)?;
    Ok(power_mean(turns, exponent))
}

/// `(sum n |x|^p / sum n)^(1/p)`.
pub(crate) fn power_mean(weighted: &[(f64, f64)], p: f64) -> Option<f64> {
    let total: f64 = weighted.iter().map(|(_, n)| n).sum();
    let largest = weighted.iter().map(|(x, _)| x.abs()).fold(0.0, f64::max);
    if total <= 0.0 {
        return None;
    }
    if largest == 0.0 {
        return Some(0.0);
    }
    let sum: f64 = (weighted.iter())
        .map(|(x, n)| n * (x.abs() / largest).powf(p))
        .sum();
    Some(largest * (sum / total).powf(p.recip()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_spectrum_of_two_torques() {
        let turns = [(100.0, 3.0), (-200.0, 1.0)];
        let cubic = equivalent_torque(&turns, 3.0).unwrap().unwrap();
        assert!((cubic - (2.75e6_f64).cbrt()).abs() < 1e-9, "{cubic}");
        assert_eq!(equivalent_torque(&[], 3.0), Ok(None));
        assert!(equivalent_torque(&turns, 0.0).is_err());
    }
}
