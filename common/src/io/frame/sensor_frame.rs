//! Encodes the health of one sensor as a CAN frame and decodes it (`SensorFrame`): fault,
//! innovation in standard deviations, NIS, and whether the angle is homed.

use crate::io::estimate::{MAX_SENSORS, SensorEstimate};
use crate::io::fault::Fault;
use crate::io::frame::signal_layout::sensor_health as field;

/// One sensor against the model, as it travels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SensorFrame {
    /// Why the reading was not used.
    pub fault: Fault,
    /// `round(64 innovation / sqrt(variance))`, limited to +-2047;
    /// [`SensorFrame::NO_INNOVATION`] where there is none.
    pub innovation: i16,
    /// `round(64 nis)`, limited to 65534; [`SensorFrame::NO_NIS`] where there is none.
    pub nis: u16,
    /// Whether the angle is homed.
    pub homed: bool,
}

impl SensorFrame {
    /// Counts per standard deviation, and per unit of NIS.
    pub const STEPS: f32 = 64.0;
    /// No innovation.
    pub const NO_INNOVATION: i16 = -2048;
    /// No NIS.
    pub const NO_NIS: u16 = u16::MAX;

    pub(crate) fn of(sensor: &SensorEstimate, homed: bool) -> Self {
        let innovation = sensor.innovation / libm::sqrtf(sensor.innovation_variance);
        let innovation = if innovation.is_finite() {
            libm::rintf((innovation * Self::STEPS).clamp(-2047.0, 2047.0)) as i16
        } else {
            Self::NO_INNOVATION
        };
        let nis = if sensor.nis.is_finite() {
            libm::rintf((sensor.nis * Self::STEPS).clamp(0.0, 65_534.0)) as u16
        } else {
            Self::NO_NIS
        };
        Self {
            fault: sensor.fault,
            innovation,
            nis,
            homed,
        }
    }

    pub(crate) fn encode(self, sensor: u32) -> u64 {
        field::SENSOR.put(sensor)
            | field::SENSOR_FAULT.put(self.fault as u32)
            | field::HOMED.put(self.homed.into())
            | field::SENSOR_INNOVATION.put(self.innovation as u32)
            | field::SENSOR_NIS.put(self.nis.into())
    }

    pub(crate) fn decode(payload: u64) -> Option<(usize, Self)> {
        let sensor = field::SENSOR.get(payload) as usize;
        let frame = Self {
            fault: Fault::from_code(field::SENSOR_FAULT.get(payload))?,
            innovation: field::SENSOR_INNOVATION.get(payload) as i16,
            nis: field::SENSOR_NIS.get(payload) as u16,
            homed: field::HOMED.get(payload) != 0,
        };
        (sensor < MAX_SENSORS).then_some((sensor, frame))
    }

    /// Normalised innovation squared; `None` where there is none.
    pub fn nis(&self) -> Option<f32> {
        (self.nis != Self::NO_NIS).then(|| f32::from(self.nis) / Self::STEPS)
    }

    /// Innovation over its standard deviation; `None` where there is none.
    pub fn innovation(&self) -> Option<f32> {
        (self.innovation != Self::NO_INNOVATION).then(|| f32::from(self.innovation) / Self::STEPS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(innovation: f32, innovation_variance: f32) -> SensorFrame {
        let nis = innovation * innovation / innovation_variance;
        let sensor = SensorEstimate {
            innovation,
            innovation_variance,
            nis,
            ..Default::default()
        };
        SensorFrame::of(&sensor, true)
    }

    #[test]
    fn an_innovation_is_told_in_standard_deviations() {
        let f = frame(-3e-6, 4e-12);
        assert_eq!((f.innovation(), f.nis()), (Some(-1.5), Some(2.25)));
    }

    #[test]
    fn large_ones_saturate_and_none_has_its_code() {
        let f = frame(1.0, 1e-12);
        assert_eq!((f.innovation, f.nis), (2047, 65_534));
        let f = frame(0.0, 0.0);
        assert_eq!((f.innovation(), f.nis()), (None, None));
    }

    #[test]
    fn every_code_survives() {
        for sensor in 0..MAX_SENSORS {
            for fault in Fault::ALL {
                for (innovation, nis, homed) in
                    [(-2048, 0, false), (-1, 1, true), (2047, 65_535, true)]
                {
                    let f = SensorFrame {
                        fault,
                        innovation,
                        nis,
                        homed,
                    };
                    assert_eq!(
                        SensorFrame::decode(f.encode(sensor as u32)),
                        Some((sensor, f))
                    );
                }
            }
        }
    }
}
