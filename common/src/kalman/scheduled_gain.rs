//! Corrects the state of a Kalman filter by gains computed beforehand, constant or interpolated
//! over a periodic angle (`GainSchedule`), in place of the covariance recursion. Used by tests and
//! benchmarks; the gearbox has its own table of steady gains.

use nalgebra::{SMatrix, SVector};

use crate::error::Error;

/// Steady-state gain and load variances at one angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GainBin<const NX: usize, const NY: usize, const ND: usize> {
    /// `K`, NX x NY, [state unit / measurement unit].
    pub gain: SMatrix<f32, NX, NY>,
    /// Diagonal of the loads' block of `P+`, [load unit]^2.
    pub load_variances: SVector<f32, ND>,
}

/// Gains over one turn of an angle, linear between bins, closed at 2 pi.
///
/// Bin `i` of `n` holds the gain at `2 pi i / n`. One bin is the
/// constant-gain filter. A step is [`crate::kalman::transition::Transition::propagate`],
/// then `x+ = x + K(theta) nu` with all innovations taken at the prior.
///
/// ```
/// use loadtwin_common::kalman::scheduled_gain::{GainBin, GainSchedule};
/// use nalgebra::{Matrix2x1, Vector1, Vector2};
///
/// let bin = |k| GainBin { gain: Matrix2x1::new(k, 2.0 * k), load_variances: Vector1::new(k) };
/// let bins = [bin(0.0), bin(0.4)];
/// let schedule = GainSchedule::try_new(&bins)?;
/// let mut state = Vector2::new(1.0, 1.0);
/// let place = schedule.at(core::f32::consts::FRAC_PI_2).unwrap(); // half way between the bins
/// assert_eq!(place.correct(&mut state, &Vector1::new(5.0)), 1);
/// assert!((state - Vector2::new(2.0, 3.0)).amax() < 1e-5);
/// assert!((place.load_variances()[0] - 0.2).abs() < 1e-6);
/// # Ok::<(), loadtwin_common::Error>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct GainSchedule<'a, const NX: usize, const NY: usize, const ND: usize> {
    bins: &'a [GainBin<NX, NY, ND>],
    bins_per_rad: f32,
}

impl<'a, const NX: usize, const NY: usize, const ND: usize> GainSchedule<'a, NX, NY, ND> {
    /// Schedule over `bins`, 1 to 65536 of them, evenly spaced from angle 0.
    ///
    /// # Errors
    /// `OutOfRange("bins")`, `NotFinite("gain")`, `NotPositive("load_variances")`.
    pub fn try_new(bins: &'a [GainBin<NX, NY, ND>]) -> Result<Self, Error> {
        const { assert!(NY <= 32, "one bit for each channel") };
        if !(1..=65536).contains(&bins.len()) {
            return Err(Error::OutOfRange("bins"));
        }
        if !bins.iter().flat_map(|bin| &bin.gain).all(|k| k.is_finite()) {
            return Err(Error::NotFinite("gain"));
        }
        if !bins
            .iter()
            .flat_map(|bin| &bin.load_variances)
            .all(|p| *p >= 0.0 && p.is_finite())
        {
            return Err(Error::NotPositive("load_variances"));
        }
        Ok(Self {
            bins,
            bins_per_rad: bins.len() as f32 * core::f32::consts::FRAC_1_PI * 0.5,
        })
    }

    /// The bins around an angle (rad) of any turn; none when the angle is not
    /// finite or so large that f32 no longer resolves a bin.
    #[inline]
    pub fn at(&self, angle_rad: f32) -> Option<Place<'a, NX, NY, ND>> {
        let position = angle_rad * self.bins_per_rad;
        if position.is_nan() || position.abs() >= 4_194_304.0 {
            return None;
        }
        let mut whole = position as i32;
        if (whole as f32) > position {
            whole -= 1;
        }
        let index = whole.checked_rem_euclid(self.bins.len() as i32)? as usize;
        let low = self.bins.get(index)?;
        let high = self.bins.get(index + 1).or(self.bins.first())?;
        Some(Place {
            low,
            high,
            fraction: position - whole as f32,
        })
    }
}

/// A place between two bins of a schedule.
#[derive(Clone, Copy, Debug)]
pub struct Place<'a, const NX: usize, const NY: usize, const ND: usize> {
    low: &'a GainBin<NX, NY, ND>,
    high: &'a GainBin<NX, NY, ND>,
    fraction: f32,
}

impl<const NX: usize, const NY: usize, const ND: usize> Place<'_, NX, NY, ND> {
    /// `x+ = x + K nu` without the channels whose innovation is not finite.
    ///
    /// `innovation`: `nu = y - h(x)`, [measurement units], NaN where missing.
    /// Returns one bit for each channel used, channel 0 the lowest.
    #[inline]
    pub fn correct(&self, state: &mut SVector<f32, NX>, innovation: &SVector<f32, NY>) -> u32 {
        let x = &mut state.data.0[0];
        let mut used = 0;
        for i in 0..NY {
            let nu = innovation.data.0[0][i];
            if nu.is_finite() {
                used |= 1 << i;
                let share = nu * self.fraction;
                let rest = nu - share;
                for j in 0..NX {
                    x[j] += self.low.gain.data.0[i][j] * rest;
                    x[j] += self.high.gain.data.0[i][j] * share;
                }
            }
        }
        used
    }

    /// Variances of the loads after the correction, all channels used,
    /// [load unit]^2.
    #[inline]
    pub fn load_variances(&self) -> SVector<f32, ND> {
        let (low, high) = (&self.low.load_variances, &self.high.load_variances);
        SVector::from_fn(|i, _| {
            let low = low.data.0[0][i];
            low + (high.data.0[0][i] - low) * self.fraction
        })
    }
}
