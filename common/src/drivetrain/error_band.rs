//! Computes the variance that is stated with a load from the filter's variance and the errors
//! measured against references in a calibration (`ErrorBand`): larger where the load moves faster
//! than there (`Movement`) or a sensor is missing.

use serde::{Deserialize, Serialize};

use crate::error::{Error, positive};

/// Movement at which it no longer counts how fast a load moves.
const MOST_MOVEMENT: f32 = 1e6;

/// How large the error of a load was in a calibration beside the covariance `P` of the filter.
///
/// The random walk of a load is chosen for the bandwidth. `P` is therefore the covariance of a load
/// that moves at that rate all the time; the error is smaller while the load is calm, and larger
/// while it moves faster. With the measured ratio `f` of error to deviation the stated variance is
///
/// `sigma^2 = f^2 P + max((s - s_0) P, (1 - f^2) (P - P_0), 0)`.
///
/// `s` is the movement of the load over that of the walk (`Movement`), `s_0` that of the
/// calibration: the error of a filter is linear in the noise that moves the load (Mehra 1970, IEEE
/// TAC 15-2). What `P` has beyond that of the calibration, `P_0`, is uncertainty of another
/// kind: a start, a sensor that is missing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ErrorBand {
    /// `f`, error over stated standard deviation, > 0; 1 where it was not measured.
    pub error_over_std: f32,
    /// `P_0`, variance of the load in the calibration (nominal loads squared), >= 0; 0 where it was
    /// not measured.
    pub variance: f32,
    /// `s_0`, movement of the load in the calibration, >= 0.
    pub movement: f32,
}

impl Default for ErrorBand {
    /// Not measured: `sigma^2 = P`.
    fn default() -> Self {
        Self {
            error_over_std: 1.0,
            variance: 0.0,
            movement: MOST_MOVEMENT,
        }
    }
}

impl ErrorBand {
    pub(crate) fn check(&self) -> Result<(), Error> {
        positive([self.error_over_std], "error band")?;
        let is_part = |value: f32| value >= 0.0 && value.is_finite();
        if is_part(self.variance) && is_part(self.movement) {
            Ok(())
        } else {
            Err(Error::OutOfRange("error band"))
        }
    }

    /// `sigma^2` for the variance `p` of the filter and the movement `s` of the load.
    pub(crate) fn stated_variance(&self, p: f32, s: f32) -> f32 {
        let measured = self.error_over_std * self.error_over_std;
        let moving = (s - self.movement) * p;
        let beyond = (1.0 - measured) * (p - self.variance);
        // Compared, since a Cortex-M4 calls a function for `max`.
        let wider = if moving > beyond { moving } else { beyond };
        p * measured + if wider > 0.0 { wider } else { 0.0 }
    }
}

/// How fast a load moves beside its random walk.
///
/// A walk of variance `q` a sample is `d` off its mean over `1 / a` samples, `E d^2 = q / 2 a`.
/// Over the time in which it moves by twice the deviation of the filter, `a = q / 4 P_0`, that is
/// `2 P_0`. The movement is `d^2 / 2 P_0`, held at its peaks for that time.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Movement {
    mean: f32,
    peak: f32,
}

impl Movement {
    /// Takes the next estimate in, of a load with the step variance `q`; 0 where nothing was
    /// measured.
    pub(crate) fn follow(&mut self, load: f32, q: f32, band: &ErrorBand) -> f32 {
        if band.variance > 0.0 {
            // Compared, since a Cortex-M4 calls a function for `min` and `max`.
            let part = q / (4.0 * band.variance);
            let part = if part < 1.0 { part } else { 1.0 };
            self.mean += part * (load - self.mean);
            let off = load - self.mean;
            let now = off * off / (2.0 * band.variance);
            let now = if now < MOST_MOVEMENT {
                now
            } else {
                MOST_MOVEMENT
            };
            let held = self.peak - part * self.peak;
            self.peak = if held > now { held } else { now };
        }
        self.peak
    }

    pub(crate) fn peak(self) -> f32 {
        self.peak
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BAND: ErrorBand = ErrorBand {
        error_over_std: 0.5,
        variance: 4.0,
        movement: 0.25,
    };

    #[test]
    fn worked_by_hand() {
        // As in the calibration, and calmer.
        assert_eq!(BAND.stated_variance(4.0, 0.25), 1.0);
        assert_eq!(BAND.stated_variance(2.0, 0.1), 0.5);
        // It moves half as fast as the walk, and nine times.
        assert_eq!(BAND.stated_variance(4.0, 0.75), 1.0 + 2.0);
        assert_eq!(BAND.stated_variance(4.0, 9.25), 1.0 + 36.0);
        // Without a sensor: what was added counts in full.
        assert_eq!(BAND.stated_variance(8.0, 0.25), 2.0 + 0.75 * 4.0);
        // Not measured, and larger than stated.
        assert_eq!(ErrorBand::default().stated_variance(3.0, 700.0), 3.0);
        let wide = ErrorBand {
            error_over_std: 2.0,
            ..BAND
        };
        assert_eq!(wide.stated_variance(8.0, 0.0), 32.0);
    }

    #[test]
    fn a_load_at_rest_does_not_move_and_a_ramp_does() {
        let q = 0.16;
        let mut movement = Movement {
            mean: 3.0,
            peak: 0.0,
        };
        assert_eq!(movement.follow(3.0, q, &BAND), 0.0);
        // A mean over 1 / a = 100 samples lags a ramp of 0.1 a sample by 99 steps of it.
        let mut last = 0.0;
        for k in 1..2000 {
            last = movement.follow(3.0 + 0.1 * k as f32, q, &BAND);
        }
        assert!((last - 9.9 * 9.9 / 8.0).abs() < 0.02, "{last}");
        // At rest again, its peak is down to a twentieth after three of those times.
        for _ in 0..300 {
            movement.follow(202.9, q, &BAND);
        }
        assert!(movement.peak() < 0.051 * last, "{}", movement.peak());
        let mut unmeasured = Movement::default();
        assert_eq!(unmeasured.follow(1e30, q, &ErrorBand::default()), 0.0);
    }

    #[test]
    fn ranges_are_checked() {
        assert!(BAND.check().is_ok() && ErrorBand::default().check().is_ok());
        for (error_over_std, variance, movement) in [
            (0.0, 4.0, 0.2),
            (f32::NAN, 4.0, 0.2),
            (0.5, -1.0, 0.2),
            (0.5, f32::INFINITY, 0.2),
            (0.5, 4.0, -1.0),
            (0.5, 4.0, f32::NAN),
        ] {
            let band = ErrorBand {
                error_over_std,
                variance,
                movement,
            };
            assert!(band.check().is_err(), "{band:?}");
        }
    }
}
