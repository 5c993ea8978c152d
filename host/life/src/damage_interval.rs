//! Computes a damage figure from the cycles of the smoothed load, and its 90 % interval from the
//! same cycles with all ranges narrower and wider by the noise of the estimate, and from those of
//! the load as estimated (`NoiseRemoved`).

use crate::{CountedLoad, LifeError, Spectrum};

/// Standard deviations to either side of an interval of 90 %, normal distribution.
const TWO_SIDED_90: f64 = 1.644_854;

/// A figure and the interval that holds the true one in 90 % of cases.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// The figure.
    pub value: f64,
    /// Lower end.
    pub lower: f64,
    /// Upper end.
    pub upper: f64,
}

/// Cycles between what the data can exclude at either end.
///
/// Noise of an estimate adds small cycles and widens large ones; removing it by
/// smoothing also removes fast movements of the load. So the cycles of the
/// smoothed load are the figure, and those as estimated belong to the interval.
/// A range has the error of both its ends, of standard deviation
/// `s = sqrt(2 P)`; all ranges are moved by `1.645 s` together, which is wider
/// than independent errors are.
#[derive(Clone, Debug, PartialEq)]
pub struct NoiseRemoved {
    estimated: Spectrum,
    smoothed: Spectrum,
    range_std: f64,
}

impl NoiseRemoved {
    /// Of one load in one machine or several; none where a machine has no standard deviations.
    ///
    /// # Errors
    /// As [`Spectrum::of`] and [`Spectrum::merge`].
    pub fn of(
        name: &str,
        machines: &[CountedLoad],
        estimated: &Spectrum,
    ) -> Result<Option<Self>, LifeError> {
        let mut smoothed: Option<Spectrum> = None;
        let (mut sum, mut samples) = (0.0, 0.0);
        for machine in machines {
            let Some((counts, variance)) = machine.smoothed() else {
                return Ok(None);
            };
            let spectrum = Spectrum::of(name, counts)?;
            match &mut smoothed {
                Some(all) => all.merge(name, &spectrum)?,
                None => smoothed = Some(spectrum),
            }
            let seen = counts.observation().seen as f64;
            sum += variance * seen;
            samples += seen;
        }
        Ok(smoothed.map(|smoothed| Self {
            estimated: estimated.clone(),
            smoothed,
            range_std: (2.0 * sum / samples).sqrt(),
        }))
    }

    /// Standard deviation of a range (in the unit of the load).
    pub fn range_std(&self) -> f64 {
        self.range_std
    }

    /// A figure that grows with the ranges.
    ///
    /// # Errors
    /// As `figure`.
    pub fn interval<E>(&self, figure: impl Fn(&Spectrum) -> Result<f64, E>) -> Result<Interval, E> {
        let by = TWO_SIDED_90 * self.range_std;
        Ok(Interval {
            value: figure(&self.smoothed)?,
            lower: figure(&self.smoothed.widened(-by))?,
            upper: figure(&self.smoothed.widened(by))?.max(figure(&self.estimated)?),
        })
    }
}
