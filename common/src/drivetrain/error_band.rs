//! Deviation of a load as measured against references: the part of the filter's covariance that the
//! error takes, and what widens it to all of it again.

use serde::{Deserialize, Serialize};

use crate::error::{Error, positive};

/// How large the error of a load was in a calibration beside the covariance `P` of the filter.
///
/// The random walk of a load is chosen for the bandwidth. `P` is therefore the covariance of a load
/// that varies at that rate all the time; the error is smaller while the load is calm. With the
/// measured ratio `f` of error to deviation the stated variance is
///
/// `sigma^2 = f^2 P + (1 - f^2) max(w P, P - P_0, 0)`, `w = (n - n_0) / (1 - n_0)`, 0 to 1,
///
/// and `f^2 P` where `f >= 1`. `n` is the normalised innovation squared of the gauges: as large as
/// in the calibration (`n_0`) it leaves `f^2 P`, at 1, where the load varies as the walk says, it
/// gives `P` (covariance matching: Mehra 1970, IEEE TAC 15-2). What `P` has beyond that of the
/// calibration, `P_0`, is uncertainty of another kind: a start, a sensor that is missing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ErrorBand {
    /// `f`, error over stated standard deviation, > 0; 1 where it was not measured.
    pub error_over_std: f32,
    /// `P_0`, variance of the load in the calibration (nominal loads squared), >= 0.
    pub variance: f32,
    /// `n_0`, NIS of the gauges in the calibration, 0 to below 1.
    pub nis: f32,
}

impl Default for ErrorBand {
    /// Not measured: `sigma^2 = P`.
    fn default() -> Self {
        Self {
            error_over_std: 1.0,
            variance: 0.0,
            nis: 0.0,
        }
    }
}

impl ErrorBand {
    pub(crate) fn check(&self) -> Result<(), Error> {
        positive([self.error_over_std], "error band")?;
        if self.variance >= 0.0 && self.variance.is_finite() && (0.0..1.0).contains(&self.nis) {
            Ok(())
        } else {
            Err(Error::OutOfRange("error band"))
        }
    }

    /// `sigma^2` for the variance `p` of the filter and the NIS of the gauges.
    pub(crate) fn stated_variance(&self, p: f32, nis: f32) -> f32 {
        let measured = self.error_over_std * self.error_over_std;
        let varying = ((nis - self.nis) / (1.0 - self.nis)).clamp(0.0, 1.0);
        let beyond = (varying * p).max(p - self.variance);
        p * measured + (1.0 - measured).max(0.0) * beyond
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BAND: ErrorBand = ErrorBand {
        error_over_std: 0.5,
        variance: 4.0,
        nis: 0.25,
    };

    #[test]
    fn worked_by_hand() {
        // As in the calibration, and calmer.
        assert_eq!(BAND.stated_variance(4.0, 0.25), 1.0);
        assert_eq!(BAND.stated_variance(2.0, 0.1), 0.5);
        // Half as far as the walk says, and as far.
        assert_eq!(BAND.stated_variance(4.0, 0.625), 1.0 + 0.75 * 2.0);
        assert_eq!(BAND.stated_variance(4.0, 1.0), 4.0);
        assert_eq!(BAND.stated_variance(4.0, 9.0), 4.0);
        // Without a sensor: what was added counts in full.
        assert_eq!(BAND.stated_variance(8.0, 0.25), 2.0 + 0.75 * 4.0);
        // Not measured, and larger than stated.
        assert_eq!(ErrorBand::default().stated_variance(3.0, 0.7), 3.0);
        let wide = ErrorBand {
            error_over_std: 2.0,
            ..BAND
        };
        assert_eq!(wide.stated_variance(8.0, 9.0), 32.0);
    }

    #[test]
    fn ranges_are_checked() {
        assert!(BAND.check().is_ok() && ErrorBand::default().check().is_ok());
        for (error_over_std, variance, nis) in [
            (0.0, 4.0, 0.2),
            (f32::NAN, 4.0, 0.2),
            (0.5, -1.0, 0.2),
            (0.5, f32::INFINITY, 0.2),
            (0.5, 4.0, 1.0),
            (0.5, 4.0, f32::NAN),
        ] {
            let band = ErrorBand {
                error_over_std,
                variance,
                nis,
            };
            assert!(band.check().is_err(), "{band:?}");
        }
    }
}
