//! Damage by the Palmgren-Miner rule from a spectrum of load cycles and an S-N curve, and
//! damage-equivalent loads.

use crate::error::positive;
use crate::{LifeError, LoadCycle, SnCurve, Spectrum};

/// Exponents that equivalent loads are given for: welded steel to fibre composites.
pub const EXPONENTS: [f64; 10] = [3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0];

/// Damage by Palmgren-Miner: `D = sum n_i / N(S_i)`; failure is expected at 1.
pub fn damage(spectrum: &Spectrum, curve: &SnCurve) -> f64 {
    damage_of_cycles(spectrum.cycles(), curve)
}

/// As [`damage`], of cycles that nothing has counted.
pub fn damage_of_cycles(cycles: impl Iterator<Item = LoadCycle>, curve: &SnCurve) -> f64 {
    let parts = cycles.filter_map(|cycle| {
        let cycles_to_failure = curve.cycles_to_failure(cycle.range)?;
        Some(cycle.count / cycles_to_failure)
    });
    // An empty sum of floats is -0.
    parts.fold(0.0, |sum, part| sum + part)
}

/// Range of `cycles` equal cycles that do the same damage:
/// `DEL = (sum n_i S_i^m / cycles)^(1/m)`, in the unit of the load.
///
/// # Errors
/// [`LifeError::Number`] when exponent or cycles are not above zero.
pub fn equivalent_load(spectrum: &Spectrum, exponent: f64, cycles: f64) -> Result<f64, LifeError> {
    positive("exponent", exponent)?;
    positive("equivalent cycles", cycles)?;
    // In parts of the largest range, so that no power overflows.
    let largest = spectrum
        .cycles()
        .map(|cycle| cycle.range)
        .fold(0.0, f64::max);
    if largest == 0.0 {
        return Ok(0.0);
    }
    let sum: f64 = (spectrum.cycles())
        .map(|cycle| cycle.count * (cycle.range / largest).powf(exponent))
        .sum();
    Ok(largest * (sum / cycles).powf(exponent.recip()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Beyond;
    use loadtwin_common::counting::{LevelScale, LoadCounts};

    fn spectrum(cycles: usize) -> Spectrum {
        let scale = LevelScale::covering(-64.0, 64.0).unwrap();
        let mut counts = LoadCounts::try_new(scale, 1).unwrap();
        for _ in 0..cycles {
            counts.push(Some(-10.0), [0; 2]);
            counts.push(Some(10.0), [0; 2]);
        }
        counts.push(Some(-10.0), [0; 2]);
        Spectrum::of("a", &counts).unwrap()
    }

    #[test]
    fn equal_cycles_are_their_own_equivalent() {
        for exponent in EXPONENTS {
            let load = equivalent_load(&spectrum(1000), exponent, 1000.0).unwrap();
            assert!((load - 20.0).abs() < 1e-9, "{exponent}: {load}");
            let load = equivalent_load(&spectrum(1000), exponent, 1.0).unwrap();
            assert!((load / 20.0 / 1000.0_f64.powf(1.0 / exponent) - 1.0).abs() < 1e-12);
        }
        assert_eq!(equivalent_load(&spectrum(0), 3.0, 1.0), Ok(0.0));
    }

    #[test]
    fn damage_is_the_sum_of_parts() {
        let curve = SnCurve::with_slope(3.0, 1e6, 20.0, Beyond::CutOff).unwrap();
        assert!((damage(&spectrum(500), &curve) - 5e-4).abs() < 1e-15);
        let strong = SnCurve::with_slope(3.0, 1e6, 21.0, Beyond::CutOff).unwrap();
        for none in [
            damage(&spectrum(500), &strong),
            damage(&spectrum(0), &strong),
        ] {
            assert!(none == 0.0 && none.is_sign_positive(), "{none:?}");
        }
    }

    #[test]
    fn exponent_zero_is_refused() {
        let error = equivalent_load(&spectrum(1), 0.0, 1.0).unwrap_err();
        assert_eq!(error.to_string(), "exponent 0: allowed: above 0");
        assert!(equivalent_load(&spectrum(1), 3.0, 0.0).is_err());
    }
}
