//! Defines the parameters of a drive in a model image (`DriveModel`: sensors, inertia, drag, noise,
//! friction and other terms) and checks their ranges before the estimator is built.

use heapless::{String, Vec};
use serde::{Deserialize, Serialize};

use crate::drive::delay_line::MAX_DELAY;
use crate::drive::term::{Direction, MAX_DIRECTIONS, MAX_TERMS, Term};
use crate::error::{Error, finite, positive};
use crate::io::estimate::MAX_LOADS;
use crate::io::measurement::{AdcScaling, EncoderScaling};
use crate::load_signal::LoadSignal;

/// Most measured loads that a drive works against.
pub const MAX_KNOWN: usize = 6;

/// Longest unit (bytes).
pub const MAX_UNIT: usize = 8;

/// The numbers of a drive in a model image.
///
/// `drive = offset + inertia a + drag v + sum_j L_j + sum_k term_k + unknown`, all in the drive's
/// unit. The words of a sample are the drive where it is measured, the speed where it is, then the
/// known loads; its first counter is the position where that is measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DriveModel<'a> {
    /// Sample period (s), > 0.
    pub sample_s: f32,
    /// The unknown load, or the drive where that is not measured; one.
    pub loads: Vec<LoadSignal, MAX_LOADS>,
    /// Unit of the drive.
    pub unit: String<MAX_UNIT>,
    /// The drive; none where it is what is estimated.
    pub drive: Option<Signal>,
    /// The position; it or the speed is measured.
    pub position: Option<PositionSensor>,
    /// The speed.
    pub speed: Option<Signal>,
    /// Measured loads that the drive works against.
    pub known: Vec<Signal, MAX_KNOWN>,
    /// Drive at standstill, without load.
    pub offset: f32,
    /// Drive per acceleration.
    pub inertia: f32,
    /// Drive per speed.
    pub drag: f32,
    /// Power density of the jerk [(rad/s^3)^2/Hz, (m/s^3)^2/Hz], > 0.
    pub jerk_density: f32,
    /// Variance that the unknown load gains in a sample [unit^2], > 0.
    pub load_variance: f32,
    /// Standard deviation of what the model leaves unexplained [unit], > 0.
    pub model_std: f32,
    /// Standard deviation before the first sample of position, speed, acceleration and load, > 0.
    pub initial_std: [f32; 4],
    /// Directions that terms refer to.
    pub directions: Vec<Direction, MAX_DIRECTIONS>,
    /// Known terms.
    #[serde(borrow)]
    pub terms: Vec<Term<'a>, MAX_TERMS>,
}

/// An analogue channel of a drive.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Signal {
    /// Word to SI.
    pub converter: AdcScaling,
    /// Standard deviation of a reading, > 0.
    pub noise_std: f32,
    /// Samples by which it is early against the latest signal, 0 to [`MAX_DELAY`].
    pub delay: f32,
}

/// The position as counts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PositionSensor {
    /// The counter; its `step` is not used.
    pub counter: EncoderScaling,
    /// Travel of one count [rad, m], not 0.
    pub count: f32,
    /// Position at count 0 [rad, m].
    pub at_zero: f32,
    /// Count at the index pulse; none where the counter is absolute.
    pub at_pulse: Option<i32>,
    /// Standard deviation of a reading [rad, m], > 0.
    pub noise_std: f32,
    /// As that of a [`Signal`].
    pub delay: f32,
}

impl Signal {
    fn check(&self) -> Result<(), Error> {
        positive([self.noise_std], "noise_std")?;
        check_delay(self.delay)?;
        finite(&[self.converter.gain], 1, "channel gain")?;
        if self.converter.gain == 0.0 {
            return Err(Error::OutOfRange("channel gain"));
        }
        Ok(())
    }
}

impl PositionSensor {
    fn check(&self) -> Result<(), Error> {
        positive([self.noise_std], "noise_std")?;
        check_delay(self.delay)?;
        finite(&[self.count, self.at_zero], 2, "position")?;
        if self.count == 0.0 || !(1..=32).contains(&self.counter.bits) {
            return Err(Error::OutOfRange("position"));
        }
        Ok(())
    }
}

fn check_delay(delay: f32) -> Result<(), Error> {
    if (0.0..MAX_DELAY).contains(&delay) {
        Ok(())
    } else {
        Err(Error::OutOfRange("delay"))
    }
}

impl DriveModel<'_> {
    /// The analogue channels in the order of the words.
    pub(crate) fn signals(&self) -> impl Iterator<Item = &Signal> {
        self.drive.iter().chain(&self.speed).chain(&self.known)
    }

    /// The name of the first number that is out of its range.
    pub(crate) fn check(&self) -> Result<(), Error> {
        if self.loads.len() != 1 {
            return Err(Error::OutOfRange("number of loads"));
        }
        if self.position.is_none() && self.speed.is_none() {
            return Err(Error::OutOfRange("position or speed"));
        }
        positive([self.sample_s], "sample_s")?;
        positive([self.jerk_density], "jerk_density")?;
        positive([self.load_variance], "load_variance")?;
        positive([self.model_std], "model_std")?;
        positive(self.initial_std, "initial_std")?;
        finite(&[self.offset, self.inertia, self.drag], 3, "linear part")?;
        self.signals().try_for_each(Signal::check)?;
        self.position.iter().try_for_each(PositionSensor::check)?;
        (self.directions.iter()).try_for_each(|direction| direction.check())?;
        let (loads, directions) = (self.known.len(), self.directions.len());
        let has_position = self.position.is_some();
        (self.terms.iter()).try_for_each(|term| term.check(loads, directions, has_position))
    }
}
