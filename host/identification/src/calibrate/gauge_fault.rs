//! Detects faults of gauges in a calibration: missing, stuck, dead, wrong sign or wrong gain, by
//! counts of readings, fitted gain and R^2; and gauges that are swapped, by the misfit to each
//! other's maps.

use std::fmt;

use crate::calibrate::channel_moments::{Moments, Sums};
use loadtwin_machine::resampled;

/// Bins in which readings are compared with the maps of other gauges.
const COMPARED: usize = 512;

/// What is wrong with a gauge.
#[derive(Clone, Debug, PartialEq)]
pub enum GaugeFault {
    /// More than half of its readings are missing.
    Missing,
    /// This part of its readings repeated the word before for too long.
    Stuck(f64),
    /// It does not respond to the load: this part of the described response is there.
    Dead(f64),
    /// It responds with the opposite sign, with this gain.
    WrongSign(f64),
    /// It responds with the wrong size: this gain.
    Gain(f64),
    /// It reads what another gauge should, and the other way round.
    SwappedWith(String),
}

impl fmt::Display for GaugeFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Missing => write!(f, "more than half of its readings are missing"),
            Self::Stuck(part) => write!(f, "stuck in {:.1} % of its readings", 100.0 * part),
            Self::Dead(gain) => {
                write!(f, "dead: {:.1} % of the described response", 100.0 * gain)
            }
            Self::WrongSign(gain) => write!(f, "wrong sign: gain {gain:.2}"),
            Self::Gain(gain) => write!(f, "gain {gain:.2}, allowed: 0.5 to 2"),
            Self::SwappedWith(name) => write!(f, "swapped with {name}"),
        }
    }
}

/// Largest part of stuck readings that a sound gauge may show.
const STUCK_PART: f64 = 0.01;

/// Time after which equal words count as stuck where the description says nothing [s].
pub const STUCK_AFTER_S: f64 = 2.0;

/// The fault of a single gauge, from its readings and its fitted gain.
pub fn of_gauge(
    moments: &Moments,
    samples: u64,
    gain: Option<f64>,
    r2: Option<f64>,
) -> Option<GaugeFault> {
    let stuck = moments.stuck() as f64 / samples.max(1) as f64;
    if 2 * moments.missing() > samples {
        return Some(GaugeFault::Missing);
    }
    if stuck > STUCK_PART {
        return Some(GaugeFault::Stuck(stuck));
    }
    let gain = gain?;
    if gain.abs() < 0.2 || r2.is_none_or(|r2| r2 < 0.1) {
        Some(GaugeFault::Dead(gain))
    } else {
        GaugeFault::of_gain(gain)
    }
}

impl GaugeFault {
    /// What a fitted gain, in parts of the described one, contradicts.
    pub(crate) fn of_gain(gain: f64) -> Option<Self> {
        if gain < 0.0 {
            Some(Self::WrongSign(gain))
        } else if !(0.5..=2.0).contains(&gain) {
            Some(Self::Gain(gain))
        } else {
            None
        }
    }
}

/// Pairs of gauges that read as the other one is described.
///
/// Both must be far from their own description (2 % of their variance, gain 1,
/// any offset), four times nearer to the other's, and each the other's nearest.
pub fn swapped(gauges: &[(&Moments, &[f64])]) -> Vec<(usize, usize)> {
    let coarse: Vec<Vec<Sums>> = gauges.iter().map(|(m, _)| m.coarse(COMPARED)).collect();
    let maps: Vec<Vec<f64>> = gauges
        .iter()
        .map(|(_, map)| {
            if map.len() == 1 {
                vec![map[0]; COMPARED]
            } else {
                resampled(map, COMPARED)
            }
        })
        .collect();
    let misfit: Vec<Vec<f64>> = coarse
        .iter()
        .map(|bins| maps.iter().map(|map| unexplained(bins, map)).collect())
        .collect();
    let nearest = |i: usize| {
        (0..maps.len())
            .min_by(|a, b| misfit[i][*a].total_cmp(&misfit[i][*b]))
            .unwrap_or(i)
    };
    let reads_like = |i: usize, j: usize| {
        nearest(i) == j && misfit[i][i] > 0.02 && misfit[i][j] < 0.25 * misfit[i][i]
    };
    (0..gauges.len())
        .map(|i| (i, nearest(i)))
        .filter(|&(i, j)| i < j && reads_like(i, j) && reads_like(j, i))
        .collect()
}

/// Part of the variance of the readings that `map` does not explain, for the best offset.
fn unexplained(bins: &[Sums], map: &[f64]) -> f64 {
    let (mut n, mut error, mut square, mut y, mut yy) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for (bin, m) in bins.iter().zip(map) {
        n += bin.n;
        error += bin.error(0.0, *m);
        square += bin.squared_error(0.0, *m);
        y += bin.y;
        yy += bin.yy;
    }
    (square - error * error / n) / (yy - y * y / n)
}
