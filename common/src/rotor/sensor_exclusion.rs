//! Excludes displacement sensors of a rotor whose readings are repeatedly outside of the gate,
//! while they are a minority (`SensorExclusion`). Where more contradict the prediction, the model is taken to
//! err and all readings are used.
//!
//! A reading outside of its gate is refused. A sensor whose readings are refused again and again is
//! held out, until its readings have stayed inside for a while: passing through the right value
//! once a turn is no agreement. Sensors are held out only while they are a minority; where half of
//! them contradict at once, the model errs and not they, and all readings are used. A prediction
//! that has long been consistent counts as one more sensor: half of the sensors are held out where
//! it agrees with the others.

use serde::{Deserialize, Serialize};

use crate::io::raw::MAX_CHANNELS;

/// Score that a refused reading adds; a reading inside of the gate takes 1 away.
const REFUSED: u8 = 16;

/// Largest score: as many readings inside of the gate in a row end a flag. Longer than a sensor
/// with the wrong sign stays inside, at ten standard deviations and a thousand samples a turn.
const MOST: u8 = 128;

/// Score from which a sensor is held out: three refusals within some samples. A sound sensor has
/// one in 2 million readings at a gate of 25.
const HELD: u8 = 3 * REFUSED - 2;

/// Score of each sensor: how often its readings were outside of the gate lately.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct SensorExclusion {
    scores: [u8; MAX_CHANNELS],
    /// Sensors outside of their gates in the sample under way, and in the one before.
    contradicting: usize,
    before: usize,
    /// Sensors that may be held out at once.
    most: usize,
    /// Whether a reading outside of its gate was used in the sample under way.
    admitted: bool,
}

impl SensorExclusion {
    /// A sample of `sensors` sensors begins; `established`: whether the prediction has been
    /// consistent for long.
    pub fn begin(&mut self, sensors: usize, established: bool) {
        self.most = (sensors + usize::from(established)).saturating_sub(1) / 2;
        self.before = self.contradicting;
        self.contradicting = 0;
        self.admitted = false;
        let held = self.scores.iter().filter(|score| **score >= HELD).count();
        if held > self.most {
            self.scores = [0; MAX_CHANNELS];
            self.before = sensors;
        }
    }

    /// Whether so many sensors contradict that it is the model that errs.
    pub fn open(&self) -> bool {
        self.before > self.most
    }

    /// Whether a reading that contradicts was used in this sample.
    pub fn admitted(&self) -> bool {
        self.admitted
    }

    /// Whether a reading of this sample was outside of its gate.
    pub fn contradicted(&self) -> bool {
        self.contradicting > 0
    }

    /// Scores a reading, `within` its gate or not, and gives whether it may be used.
    pub fn accepts(&mut self, sensor: usize, within: bool) -> bool {
        let open = self.open();
        let Some(score) = self.scores.get_mut(sensor) else {
            return within;
        };
        let held = *score >= HELD;
        *score = if within {
            score.saturating_sub(1)
        } else {
            self.contradicting += 1;
            score.saturating_add(REFUSED).min(MOST)
        };
        self.admitted |= open && !within;
        (within && !held) || open
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How many of `samples` samples use sensor 0 of four, of which `wrong` are outside.
    fn used(
        exclusion: &mut SensorExclusion,
        samples: u32,
        wrong: impl Fn(usize, u32) -> bool,
    ) -> u32 {
        used_where(exclusion, samples, false, wrong)
    }

    fn used_where(
        exclusion: &mut SensorExclusion,
        samples: u32,
        established: bool,
        wrong: impl Fn(usize, u32) -> bool,
    ) -> u32 {
        let mut used = 0;
        for k in 0..samples {
            exclusion.begin(4, established);
            for i in 0..4 {
                let admitted = exclusion.accepts(i, !wrong(i, k));
                used += u32::from(i == 0 && admitted);
            }
        }
        used
    }

    #[test]
    fn one_outlier_costs_one_reading() {
        let mut exclusion = SensorExclusion::default();
        assert_eq!(used(&mut exclusion, 100, |i, k| i == 0 && k == 3), 99);
    }

    #[test]
    fn a_sensor_that_contradicts_is_held_out_for_as_long_as_it_does() {
        let mut exclusion = SensorExclusion::default();
        // Right by chance for 20 samples of a turn of 100.
        assert!(used(&mut exclusion, 100_000, |i, k| i == 0 && k % 100 >= 20) < 25);
        assert_eq!(used(&mut exclusion, 1000, |_, _| false), 1000 - 83);
    }

    #[test]
    fn where_half_of_the_sensors_contradict_all_are_used() {
        let mut exclusion = SensorExclusion::default();
        assert!(used(&mut exclusion, 1000, |i, _| i < 2) >= 999);
    }

    #[test]
    fn an_established_prediction_overrules_half_of_the_sensors_but_no_more() {
        let mut exclusion = SensorExclusion::default();
        assert_eq!(used_where(&mut exclusion, 1000, true, |i, _| i < 2), 0);
        assert!(!exclusion.admitted());
        let mut exclusion = SensorExclusion::default();
        assert!(used_where(&mut exclusion, 1000, true, |i, _| i < 3) >= 999);
        assert!(exclusion.admitted());
    }

    #[test]
    fn of_two_sensors_none_can_be_outvoted() {
        let mut exclusion = SensorExclusion::default();
        let mut used = 0;
        for _ in 0..100 {
            exclusion.begin(2, false);
            used += u32::from(exclusion.accepts(0, false));
            exclusion.accepts(1, true);
        }
        assert!(used >= 99, "{used}");
    }
}
