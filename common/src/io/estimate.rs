//! Defines the estimate of one sample (`Estimate`): loads with standard deviations and faults,
//! innovations of the sensors, shaft angle. Before it leaves the estimator, values that are not
//! finite are replaced and marked as not valid.

use heapless::Vec;
use serde::{Deserialize, Serialize};

use crate::io::fault::Fault;
use crate::io::raw::{MAX_CHANNELS, MAX_ENCODERS};

/// Loads that one machine can have.
pub const MAX_LOADS: usize = 6;

/// Sensors, analogue and encoders together, that one machine can have.
pub const MAX_SENSORS: usize = MAX_CHANNELS + MAX_ENCODERS;

/// The estimate after one sample.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Tick of the sample it was made from; the loads are of that many samples before, by which the
    /// estimates lag ([`crate::estimator::Estimator::lag_samples`]), all else is of that sample.
    pub tick: u32,
    /// The loads in the order of the image.
    pub loads: Vec<LoadEstimate, MAX_LOADS>,
    /// Analogue channels in the order of the image, then encoders.
    pub sensors: Vec<SensorEstimate, MAX_SENSORS>,
    /// Angle of the carrier (or shaft) at the sample (rad), in [-pi, pi).
    pub angle_rad: f32,
    /// Whether the angle is homed on an index pulse.
    pub homed: bool,
    /// Whether the state was corrected by steady gains.
    pub steady: bool,
    /// Samples lost just before this one.
    pub lost: u32,
}

/// Bits of infinity: those of smaller positive numbers are less.
const INFINITE: u32 = f32::INFINITY.to_bits();

impl Estimate {
    /// Empties it for the sample of `tick`, before which `lost` samples were lost.
    pub(crate) fn begin(&mut self, tick: u32, lost: u32) {
        self.loads.clear();
        self.sensors.clear();
        (self.tick, self.lost) = (tick, lost);
        (self.angle_rad, self.homed, self.steady) = (0.0, false, false);
    }

    /// Replaces values that are not finite and marks them as not valid: whatever the image, a
    /// receiver gets finite numbers, an angle in [-pi, pi) and no negative variance.
    pub(crate) fn contain(&mut self) {
        if !self.angle_rad.is_finite() {
            self.angle_rad = 0.0;
        }
        // By their bits, as integers: a comparison of floats takes twice the instructions.
        let finite = |x: f32| x.to_bits() << 1 < INFINITE << 1;
        let within = |x: f32| x.to_bits() < INFINITE;
        for load in &mut self.loads {
            if !(finite(load.value) && within(load.std)) {
                *load = LoadEstimate {
                    value: 0.0,
                    std: f32::MAX,
                    age: load.age,
                    fault: Fault::NotValid,
                };
            }
        }
        for sensor in &mut self.sensors {
            let numbers = finite(sensor.measured)
                && finite(sensor.innovation)
                && within(sensor.innovation_variance)
                && within(sensor.nis);
            if !numbers {
                *sensor = SensorEstimate {
                    fault: Fault::NotValid,
                    ..SensorEstimate::default()
                };
            }
        }
    }
}

/// One load with its standard deviation and fault.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LoadEstimate {
    /// Estimate [N m, N].
    pub value: f32,
    /// Standard deviation of the estimate [N m, N].
    pub std: f32,
    /// Samples since a sensor that responds to a load was last used, and those by which the
    /// estimate lags.
    pub age: u16,
    /// Why the estimate is not valid; `Fault::None` when it is.
    pub fault: Fault,
}

/// One sensor against the model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SensorEstimate {
    /// Reading in the sensor's unit; 0 where there was none.
    pub measured: f32,
    /// Reading minus prediction before the update; 0 where there was no reading.
    pub innovation: f32,
    /// Variance of the innovation [unit^2].
    pub innovation_variance: f32,
    /// Normalised innovation squared, `innovation^2 / variance`.
    pub nis: f32,
    /// Why the reading was not used; `Fault::None` when it was.
    pub fault: Fault,
}
