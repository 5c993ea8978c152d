//! Encodes the estimate of one load as a CAN frame and decodes it (`LoadFrame`): value and standard
//! deviation as integer parts of full scale, fault, and age of the estimate.

use crate::Error;
use crate::io::estimate::LoadEstimate;
use crate::io::fault::Fault;
use crate::io::frame::signal_layout::load;

/// A load as it travels: integers of the machine's full scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LoadFrame {
    /// `round(value / full_scale 2^17)`, limited to +-[`LoadFrame::FULL`];
    /// [`LoadFrame::NO_VALUE`] where there is none.
    pub value: i32,
    /// `ceil(std / full_scale 2^13)`, limited to [`LoadFrame::FULL_STD`];
    /// [`LoadFrame::NO_STD`] where there is none.
    pub std: u16,
    /// Why the load is not valid; `Fault::None` when it is.
    pub fault: Fault,
    /// Age code: samples up to 15, then `12 + floor(log2(samples))`.
    pub age: u8,
}

/// Counts per unit of one load.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Scale {
    value: f32,
    std: f32,
}

impl Scale {
    pub(crate) fn try_new(full_scale: f32) -> Result<Self, Error> {
        let value = LoadFrame::VALUE_STEPS / full_scale;
        // A subnormal full scale makes the quotient infinite.
        if !(full_scale > 0.0 && full_scale.is_finite() && value.is_finite()) {
            return Err(Error::NotPositive("full_scale"));
        }
        Ok(Self {
            value,
            std: LoadFrame::STD_STEPS / full_scale,
        })
    }
}

impl LoadFrame {
    /// Counts of `value` at full scale.
    pub const VALUE_STEPS: f32 = 131_072.0;
    /// Counts of `std` at full scale; its range ends at half of it.
    pub const STD_STEPS: f32 = 8192.0;
    /// Largest value: at or beyond full scale.
    pub const FULL: i32 = 131_071;
    /// No value.
    pub const NO_VALUE: i32 = -131_072;
    /// Largest standard deviation: at or beyond half of full scale.
    pub const FULL_STD: u16 = 4094;
    /// No standard deviation.
    pub const NO_STD: u16 = 4095;

    /// Rounds an estimate to the bus. A number that is not finite becomes the
    /// code for none, and is a fault where the estimator saw none.
    pub(crate) fn of(estimate: &LoadEstimate, scale: Scale) -> Self {
        let full = Self::FULL as f32;
        let mut fault = estimate.fault;
        let mut unusable = |code| {
            if fault.is_none() {
                fault = Fault::NotValid;
            }
            code
        };
        let value = if estimate.value.is_finite() {
            round((estimate.value * scale.value).clamp(-full, full)) as i32
        } else {
            unusable(Self::NO_VALUE)
        };
        let std = if estimate.std.is_finite() && estimate.std >= 0.0 {
            let counts = estimate.std * scale.std;
            // Saturates.
            let whole = counts as u16;
            let up = u16::from(f32::from(whole) < counts);
            whole.saturating_add(up).min(Self::FULL_STD)
        } else {
            unusable(i32::from(Self::NO_STD)) as u16
        };
        Self {
            value,
            std,
            fault,
            age: age_code(estimate.age),
        }
    }

    pub(crate) fn encode(self) -> u64 {
        load::VALUE.put(self.value as u32)
            | load::STD.put(self.std.into())
            | load::FAULT.put(self.fault as u32)
            | load::AGE.put(self.age.into())
    }

    pub(crate) fn decode(payload: u64) -> Option<Self> {
        Some(Self {
            value: load::VALUE.get(payload) as i32,
            std: load::STD.get(payload) as u16,
            fault: Fault::from_code(load::FAULT.get(payload))?,
            age: load::AGE.get(payload) as u8,
        })
    }

    /// The load with this full scale [N m, N]; `None` where there is none.
    pub fn value(&self, full_scale: f64) -> Option<f64> {
        (self.value != Self::NO_VALUE)
            .then(|| f64::from(self.value) * full_scale / f64::from(Self::VALUE_STEPS))
    }

    /// The standard deviation with this full scale [N m, N]; `None` where there is none.
    pub fn std(&self, full_scale: f64) -> Option<f64> {
        (self.std != Self::NO_STD)
            .then(|| f64::from(self.std) * full_scale / f64::from(Self::STD_STEPS))
    }

    /// Samples, at least, since a sensor that responds to a load was last used, and those by which
    /// the estimate lags.
    pub fn age_samples(&self) -> u32 {
        match self.age {
            age @ 0..16 => age.into(),
            age => 1 << (age - 12),
        }
    }
}

/// The nearest whole number, the even one of two, of at most 2^22: as `rint`, which on a Cortex-M4
/// is a function that takes the number apart.
fn round(x: f32) -> f32 {
    const HALVES: f32 = 12_582_912.0;
    (x + HALVES) - HALVES
}

fn age_code(samples: u16) -> u8 {
    match samples.checked_ilog2() {
        Some(log2 @ 4..) => 12 + log2 as u8,
        _ => samples as u8,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(value: f32, std: f32, fault: Fault, age: u16) -> LoadFrame {
        let estimate = LoadEstimate {
            value,
            std,
            age,
            fault,
        };
        LoadFrame::of(&estimate, Scale::try_new(2000.0).expect("positive"))
    }

    #[test]
    fn a_load_is_rounded_to_its_full_scale() {
        let f = frame(1000.0, 10.0, Fault::None, 0);
        assert_eq!(
            (f.value, f.std, f.fault, f.age),
            (65_536, 41, Fault::None, 0)
        );
        assert_eq!(f.value(2000.0), Some(1000.0));
        assert_eq!(f.std(2000.0), Some(10.009_765_625));
    }

    #[test]
    fn a_value_is_rounded_to_the_nearest_count_or_the_even_one() {
        for i in -262_142..=262_142 {
            let half = 0.5 * i as f32;
            for x in [half, half + 0.2, half - 0.2] {
                assert_eq!(round(x), libm::rintf(x), "{x}");
            }
        }
    }

    #[test]
    fn the_standard_deviation_is_never_understated() {
        assert_eq!(frame(0.0, 1e-9, Fault::None, 0).std, 1);
        assert_eq!(frame(0.0, 0.0, Fault::None, 0).std, 0);
    }

    #[test]
    fn beyond_full_scale_is_saturation_and_not_the_code_for_none() {
        assert_eq!(frame(1e30, 1e30, Fault::None, 0).value, 131_071);
        assert_eq!(frame(-1e30, 0.0, Fault::None, 0).value, -131_071);
        assert_eq!(frame(f32::MAX, f32::MAX, Fault::None, 0).std, 4094);
    }

    #[test]
    fn what_is_not_finite_does_not_leave() {
        for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let f = frame(bad, 1.0, Fault::None, 0);
            assert_eq!((f.value, f.fault), (LoadFrame::NO_VALUE, Fault::NotValid));
            assert_eq!(f.value(2000.0), None);
            let f = frame(1.0, bad, Fault::Stuck, 0);
            assert_eq!((f.std, f.fault), (LoadFrame::NO_STD, Fault::Stuck));
        }
    }

    #[test]
    fn an_age_is_exact_to_15_and_then_a_power_of_two_below() {
        for samples in 0..=u16::MAX {
            let age = LoadFrame {
                age: age_code(samples),
                ..frame(0.0, 0.0, Fault::None, 0)
            };
            let result = age.age_samples();
            assert!(result <= samples.into() && u32::from(samples) <= result.max(7) * 2 + 1);
            assert!(samples > 15 || result == samples.into());
            assert!(age.age <= 27);
        }
    }

    #[test]
    fn every_code_survives() {
        for value in [-131_072, -131_071, -1, 0, 1, 131_071] {
            for std in [0, 1, 4094, 4095] {
                for fault in Fault::ALL {
                    for age in 0..32 {
                        let f = LoadFrame {
                            value,
                            std,
                            fault,
                            age,
                        };
                        assert_eq!(LoadFrame::decode(f.encode()), Some(f));
                    }
                }
            }
        }
    }
}
