//! Basic rating life of a rolling bearing from the revolutions at each load (ISO 281).

use crate::LifeError;
use crate::error::positive;
use crate::gear_torque::power_mean;

/// Basic rating life at a spectrum of loads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RatingLife {
    /// Equivalent load P (N).
    pub equivalent: f64,
    /// Turns that 90 % of such bearings reach; none without load.
    pub l10_turns: Option<f64>,
    /// Part of the life used by the turns of the spectrum.
    pub used: f64,
}

/// `P = (sum n_i P_i^p / sum n_i)^(1/p)`, `L10 = 10^6 (C / P)^p`; none without turns.
///
/// `turns`: dynamic equivalent load `P_i = X Fr + Y Fa` (N) and turns at it;
/// `rating`: basic dynamic load rating C (N); `exponent` p: 3 for balls, 10/3 for rollers.
///
/// # Errors
/// [`LifeError::Number`] when rating or exponent are not above zero.
///
/// Source: ISO 281:2007, 5.3.1 and 6.3.1.
pub fn rating_life(
    turns: &[(f64, f64)],
    rating: f64,
    exponent: f64,
) -> Result<Option<RatingLife>, LifeError> {
    positive("load rating of the bearing", rating)?;
    positive("exponent of the bearing", exponent)?;
    let Some(equivalent) = power_mean(turns, exponent) else {
        return Ok(None);
    };
    let total: f64 = turns.iter().map(|(_, n)| n).sum();
    let l10_turns = (equivalent > 0.0).then(|| 1e6 * (rating / equivalent).powf(exponent));
    Ok(Some(RatingLife {
        equivalent,
        l10_turns,
        used: l10_turns.map_or(0.0, |l10| total / l10),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_roller_bearing_at_a_quarter_of_its_rating() {
        let life = rating_life(&[(25e3, 5e6)], 100e3, 10.0 / 3.0)
            .unwrap()
            .unwrap();
        let l10 = 1e6 * 4.0_f64.powf(10.0 / 3.0);
        assert!((life.equivalent - 25e3).abs() < 1e-6);
        assert!((life.l10_turns.unwrap() / l10 - 1.0).abs() < 1e-12);
        assert!((life.used - 5e6 / l10).abs() < 1e-12);
        assert_eq!(rating_life(&[], 1.0, 3.0), Ok(None));
        assert!(rating_life(&[(1.0, 1.0)], 0.0, 3.0).is_err());
    }
}
