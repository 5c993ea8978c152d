//! Decides the state of a machine on a day from the sums of its replay (`Verdict`): a sensor
//! contradicts the description by the limits of `loadtwin replay`, no load is valid in most
//! samples, no data, or the description fits. `worst` finds the sensor that contradicts most.

use loadtwin_replay::{BIASED, CONTRADICTING, SETTLED};
use serde::{Deserialize, Serialize};

use crate::day::{DaySums, SensorOfDay};

/// Part of the samples in which some load is valid, below which a day is not valid.
const VALID: f64 = 0.5;

/// State of a machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Verdict {
    /// A sensor disagrees with the description by the rule of `loadtwin replay`.
    Contradicts,
    /// In more than half of the samples no load is valid.
    NotValid,
    /// No sample could be replayed.
    NoData,
    /// None of the above.
    Fits,
}

impl Verdict {
    /// All states, the worst first.
    pub const ALL: [Self; 4] = [Self::Contradicts, Self::NotValid, Self::NoData, Self::Fits];

    /// What tables and pages call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Contradicts => "contradicts",
            Self::NotValid => "not valid",
            Self::NoData => "no data",
            Self::Fits => "fits",
        }
    }

    /// The state of this name.
    pub(crate) fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|verdict| verdict.name() == name)
    }

    /// The state of a day.
    pub(crate) fn of(sums: &DaySums) -> Self {
        if sums.samples == 0 {
            Self::NoData
        } else if sums.sensors.iter().any(SensorOfDay::disagrees) {
            Self::Contradicts
        } else if (sums.valid as f64) < VALID * sums.samples as f64 {
            Self::NotValid
        } else {
            Self::Fits
        }
    }
}

impl SensorOfDay {
    /// Part of the readings that contradict the description.
    pub(crate) fn share(&self) -> f64 {
        self.contradicting as f64 / self.compared.max(1) as f64
    }

    /// Whether it contradicts the description, by the rule of `loadtwin replay`.
    fn disagrees(&self) -> bool {
        let often = self.contradicting >= SETTLED && self.share() > CONTRADICTING;
        let biased = self.used > SETTLED && (self.bias / self.used as f64).abs() > BIASED;
        often || biased
    }
}

/// The sensor that contradicts most, the first of equals.
pub(crate) fn worst(sensors: &[SensorOfDay]) -> Option<&SensorOfDay> {
    let badness = |sensor: &SensorOfDay| {
        let bias = sensor.bias.abs() / sensor.used.max(1) as f64;
        (sensor.disagrees(), sensor.share(), bias)
    };
    sensors.iter().reduce(|worst, sensor| {
        if badness(sensor) > badness(worst) {
            sensor
        } else {
            worst
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mean_innovation_contradicts_as_often_ones_do() {
        let sensor = SensorOfDay {
            compared: 1000,
            contradicting: 3,
            used: 1000,
            bias: 20.0,
            nis: 990.0,
            ..SensorOfDay::default()
        };
        let of = |sensor: SensorOfDay, valid| {
            Verdict::of(&DaySums {
                samples: 1000,
                valid,
                sensors: vec![sensor],
                ..DaySums::default()
            })
        };
        assert_eq!(of(sensor.clone(), 900), Verdict::Fits);
        assert_eq!(of(sensor.clone(), 499), Verdict::NotValid);
        let biased = SensorOfDay {
            bias: -700.0,
            ..sensor.clone()
        };
        assert_eq!(of(biased.clone(), 900), Verdict::Contradicts);
        let often = SensorOfDay {
            contradicting: 100,
            ..sensor.clone()
        };
        assert_eq!(of(often, 0), Verdict::Contradicts);
        assert_eq!(Verdict::of(&DaySums::default()), Verdict::NoData);
        let both = [sensor, biased.clone()];
        assert_eq!(worst(&both), Some(&biased));
    }
}
