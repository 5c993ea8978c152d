//! Checks the speed of a rotor in a recording against the range of speeds of its model: notes where
//! it was first outside, and for how long in all.

use std::f64::consts::{PI, TAU};

use loadtwin_common::io::estimate::Estimate;

use super::Sample;
use loadtwin_machine::{Kind, Machine};

/// Time over which a speed is taken [s].
const SPAN_S: f64 = 0.1;

/// Part of the highest speed beyond the ends that is still estimated, as in the estimator.
const MARGIN: f64 = 0.02;

/// The speeds of one replay, gathered sample by sample.
pub struct Speeds {
    /// Lowest and highest that is allowed [rad/s]; none where nothing measures it.
    allowed: Option<[f64; 2]>,
    angle: f64,
    from_s: f64,
    turned: f64,
    /// Time and speed where it first was outside, and how long it was in all [s].
    outside: Option<(f64, f64)>,
    outside_s: f64,
}

impl Speeds {
    /// Nothing gathered yet; nothing to gather but on a rotor with an encoder.
    pub fn new(machine: &Machine) -> Self {
        let allowed = match machine.kind() {
            Some(Kind::Rotor(rotor)) if !machine.encoders.is_empty() => Some(rotor.schedule()),
            _ => None,
        };
        Self {
            allowed,
            angle: 0.0,
            from_s: f64::NAN,
            turned: 0.0,
            outside: None,
            outside_s: 0.0,
        }
    }

    /// Adds one sample.
    pub fn push(&mut self, sample: &Sample<'_>, estimate: &Estimate) {
        let Some([low, high]) = self.allowed else {
            return;
        };
        let angle = f64::from(estimate.angle_rad);
        self.turned += (angle - self.angle + PI).rem_euclid(TAU) - PI;
        self.angle = angle;
        let span = sample.t - self.from_s;
        if span < SPAN_S {
            return;
        }
        let (speed, margin) = (self.turned / span, MARGIN * high);
        // The first span has no begin.
        if span.is_finite() && !(low - margin..=high + margin).contains(&speed) {
            self.outside.get_or_insert((self.from_s, speed));
            self.outside_s += span;
        }
        self.from_s = sample.t;
        self.turned = 0.0;
    }

    /// Where the speed first left the schedule, in one line.
    pub fn note(&self) -> Option<String> {
        let ((at_s, speed), [low, high]) = (self.outside?, self.allowed?);
        Some(format!(
            "speed: found {speed:.1} rad/s at {at_s:.1} s, allowed: {low} to {high} rad/s \
             (rotor.schedule_rad_s); for {:.1} s the loads are not valid",
            self.outside_s
        ))
    }
}
