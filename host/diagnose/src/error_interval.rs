//! Defines the errors that a diagnosis reports (`LoadErrors`): mean absolute error of load or
//! residual (%) without and with the effects found. Computes each from sums over blocks, with its
//! prediction interval from the variation between stretches of the recordings.

use serde::Serialize;

use loadtwin_math::metrics::{Stretch, prediction_interval, relative_variance};

/// Stretches of all recordings from whose differences the variation of an error is computed.
const STRETCHES: usize = 16;

/// A mean absolute error with its 95 % prediction interval for other recordings as long.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Interval {
    /// Mean absolute error: of a drivetrain in % of the nominal torque; of rotors and bearings the
    /// residual in % of the mean displacement or strain. None where it is not known.
    pub value_percent: Option<f64>,
    /// The interval (%); none where the recordings do not say how much the error varies.
    pub interval_percent: Option<[f64; 2]>,
}

/// A model without and with the effects found.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct BeforeAfter {
    /// Without.
    pub before: Interval,
    /// With.
    pub after: Interval,
}

/// Error of the torque that all gauges give together, sample by sample; of rotors and bearings the size
/// of the residual.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct LoadErrors {
    /// Gauges as described.
    pub nominal: BeforeAfter,
    /// Zero and gain of each gauge fitted anew.
    pub recalibrated: BeforeAfter,
}

impl LoadErrors {
    /// Of blocks without and with the effects found, each by its sum and its count, where nothing
    /// is calibrated anew.
    pub(crate) fn as_described(before: &[(f64, f64)], after: &[(f64, f64)]) -> Self {
        let pair = |before, after| BeforeAfter {
            before: means(before),
            after: means(after),
        };
        Self {
            nominal: pair(before, after),
            recalibrated: pair(&[], &[]),
        }
    }
}

/// Mean of blocks, each by its sum and its count, with the interval in which it is on other
/// recordings as long [%]; none without blocks.
pub(crate) fn means(blocks: &[(f64, f64)]) -> Interval {
    let blocks: Vec<(f64, f64)> = blocks.iter().copied().filter(|b| b.1 > 0.0).collect();
    if blocks.is_empty() {
        return Interval {
            value_percent: None,
            interval_percent: None,
        };
    }
    // Stretches longer than what an error stays alike over.
    let stretches: Vec<Stretch> = blocks
        .chunks(blocks.len().div_ceil(STRETCHES))
        .map(|blocks| Stretch {
            recording: 0,
            error: blocks.iter().map(|b| b.0).sum(),
            size: blocks.iter().map(|b| b.1).sum(),
        })
        .collect();
    let sum = |of: fn(&Stretch) -> f64| stretches.iter().map(of).sum::<f64>();
    let value = 100.0 * sum(|s| s.error) / sum(|s| s.size);
    // A mean square varies twice as much as a mean size, in parts of itself.
    let variance = relative_variance(&stretches).map(|of_size| 4.0 * of_size);
    Interval {
        value_percent: Some(value),
        interval_percent: variance.and_then(|variance| prediction_interval(value, variance)),
    }
}
