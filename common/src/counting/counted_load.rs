//! What a model image states of the loads that a board counts (`CountedLoad`), and the samples of
//! them that the estimates give (`LoadSampler`): load where it is valid, advance of the shaft.

use core::f32::consts::PI;

use heapless::Vec;
use serde::{Deserialize, Serialize};

use super::load_counts::LoadCounts;
use super::scale::LevelScale;
use super::turning_points::TurningPoints;
use crate::Error;
use crate::io::estimate::Estimate;
use crate::io::fault::Fault;

/// Most loads that a machine counts.
pub const MAX_COUNTED: usize = 2;

/// Parts of a turn in an advance, a radian.
const PARTS_OF_RADIAN: f32 = 4_294_967_296.0 / (2.0 * PI);

/// The loads that a machine counts.
pub type CountedLoads = Vec<CountedLoad, MAX_COUNTED>;

/// A load that is counted, and how.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CountedLoad {
    /// Its place in the order of the estimates.
    pub load: u8,
    /// The levels.
    pub scale: LevelScale,
    /// Gate of turning points (levels), 1 to 127.
    pub gate: u8,
    /// Turns of the load's own shaft for one of the angle that is estimated, > 0.
    pub ratio: f32,
}

impl CountedLoad {
    /// Nothing counted yet.
    ///
    /// # Errors
    /// As [`Self::check`].
    pub fn empty(&self) -> Result<LoadCounts, Error> {
        self.check()?;
        LoadCounts::try_new(self.scale, self.gate)
    }

    /// Whether it can be counted.
    ///
    /// # Errors
    /// The name of the first number that is out of its range.
    pub fn check(&self) -> Result<(), Error> {
        if !(self.ratio > 0.0 && self.ratio.is_finite()) {
            return Err(Error::NotPositive("ratio of a counted load"));
        }
        if !self.scale.is_valid() {
            return Err(Error::OutOfRange("scale of levels"));
        }
        TurningPoints::try_new(self.gate).map(drop)
    }
}

/// What one sample adds to the counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CountSample {
    /// Its tick; ticks that are left out are a gap.
    pub tick: u32,
    /// By how much the estimated angle turned since the sample before (2^-32 turn), either way.
    pub advance: u32,
    /// The counted loads [N m, N], in the order of the image; NaN where not valid.
    pub loads: [f32; MAX_COUNTED],
}

/// Takes the samples of the counted loads from the estimates.
#[derive(Clone, Debug)]
pub struct LoadSampler {
    places: Vec<u8, MAX_COUNTED>,
    /// The angle of the estimate before [rad].
    angle_rad: Option<f32>,
    /// Whether it was homed.
    was_homed: bool,
}

impl LoadSampler {
    /// Counts nothing.
    pub const fn new() -> Self {
        Self {
            places: Vec::new(),
            angle_rad: None,
            was_homed: false,
        }
    }

    /// Takes `counted` of a machine with `loads` loads.
    ///
    /// # Errors
    /// The name of the first number that is out of its range.
    pub fn try_new(counted: &[CountedLoad], loads: usize) -> Result<Self, Error> {
        let mut sampler = Self::new();
        for counted in counted {
            counted.check()?;
            if usize::from(counted.load) >= loads || sampler.places.contains(&counted.load) {
                return Err(Error::OutOfRange("counted load"));
            }
            let pushed = sampler.places.push(counted.load);
            pushed.map_err(|_| Error::OutOfRange("counted loads"))?;
        }
        Ok(sampler)
    }

    /// The sample of an estimate; none where nothing is counted. Turns in a gap, and the
    /// correction of an angle that is homed, are no advance.
    pub fn take(&mut self, tick: u32, estimate: &Estimate) -> Option<CountSample> {
        if self.places.is_empty() {
            return None;
        }
        let goes_on = self.was_homed == estimate.homed && estimate.lost == 0;
        self.was_homed = estimate.homed;
        let advance = match self.angle_rad.replace(estimate.angle_rad) {
            Some(before) if goes_on => advance(before, estimate.angle_rad),
            _ => 0,
        };
        let mut loads = [f32::NAN; MAX_COUNTED];
        for (slot, &place) in loads.iter_mut().zip(&self.places) {
            if let Some(load) = estimate.loads.get(usize::from(place))
                && load.fault == Fault::None
            {
                *slot = load.value;
            }
        }
        Some(CountSample {
            tick,
            advance,
            loads,
        })
    }
}

impl Default for LoadSampler {
    fn default() -> Self {
        Self::new()
    }
}

/// The shorter way between two angles in [-pi, pi) (2^-32 turn).
fn advance(from: f32, to: f32) -> u32 {
    let direct = libm::fabsf(to - from);
    let shorter = if direct > PI {
        2.0 * PI - direct
    } else {
        direct
    };
    (shorter * PARTS_OF_RADIAN) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::estimate::LoadEstimate;

    fn counted(load: u8) -> CountedLoad {
        CountedLoad {
            load,
            scale: LevelScale::covering(-100.0, 100.0).unwrap(),
            gate: 2,
            ratio: 8.0,
        }
    }

    fn estimate(angle_rad: f32, values: [f32; 3], fault: Fault) -> Estimate {
        let load = |value| LoadEstimate {
            value,
            fault,
            ..LoadEstimate::default()
        };
        Estimate {
            loads: values.into_iter().map(load).collect(),
            angle_rad,
            homed: true,
            ..Estimate::default()
        }
    }

    #[test]
    fn samples_have_the_valid_loads_and_the_way_that_the_shaft_turned() {
        let mut sampler = LoadSampler::try_new(&[counted(2), counted(0)], 3).unwrap();
        let first = sampler.take(0, &estimate(3.0, [1.0, 2.0, 3.0], Fault::None));
        assert_eq!(first.map(|s| (s.advance, s.loads)), Some((0, [3.0, 1.0])));
        let over = estimate(-3.0, [1.0, 2.0, 3.0], Fault::Stuck);
        let second = sampler.take(1, &over).unwrap();
        assert!(second.loads.iter().all(|load| load.is_nan()));
        let turn = f64::from(second.advance) / 4_294_967_296.0;
        assert!(
            (turn - (1.0 - 6.0 / core::f64::consts::TAU)).abs() < 1e-6,
            "{turn}"
        );
        let after_gap = Estimate { lost: 3, ..over };
        assert_eq!(sampler.take(5, &after_gap).map(|s| s.advance), Some(0));
        assert_eq!(LoadSampler::new().take(0, &after_gap), None);
    }

    #[test]
    fn what_cannot_be_counted_is_refused() {
        let refused = |counted: &[CountedLoad]| LoadSampler::try_new(counted, 2).map(drop);
        assert_eq!(
            refused(&[counted(2)]),
            Err(Error::OutOfRange("counted load"))
        );
        assert_eq!(
            refused(&[counted(1); 2]),
            Err(Error::OutOfRange("counted load"))
        );
        let gate = CountedLoad {
            gate: 0,
            ..counted(0)
        };
        assert_eq!(refused(&[gate]), Err(Error::OutOfRange("gate")));
        let ratio = CountedLoad {
            ratio: f32::NAN,
            ..counted(0)
        };
        assert_eq!(
            refused(&[ratio]),
            Err(Error::NotPositive("ratio of a counted load"))
        );
    }
}
