//! Injects sudden faults of a simulated gauge: a step of its zero, debonding (loss of response),
//! bursts of an oscillation.

use rand::RngExt;

use crate::injected_effect::{Apply, Dose, Effect, Scope};
use crate::simulated_gauge::{Disturbance, Moment};

/// The zero of a channel jumps.
pub(crate) const STEP: Effect = Effect {
    name: "gauge-step",
    typical: "the zero of one channel jumps by 10 % of the reading at nominal load",
    apply: Apply::Gauges(Scope::One, |gauges, dose| {
        for gauge in gauges {
            let at = middle(dose);
            let jump = 0.1 * dose.strength * gauge.span() * sign(dose);
            gauge.disturbances.push(Box::new(Change {
                at,
                jump,
                part: 0.0,
                offset: gauge.offset,
            }));
        }
    }),
};

/// A gauge comes off its surface: it responds less.
pub(crate) const DEBONDING: Effect = Effect {
    name: "gauge-debonding",
    typical: "one channel loses 20 % of its response at some moment",
    apply: Apply::Gauges(Scope::One, |gauges, dose| {
        for gauge in gauges {
            let (at, offset) = (middle(dose), gauge.offset);
            let part = -(0.2 * dose.strength).min(1.0);
            gauge.disturbances.push(Box::new(Change {
                at,
                jump: 0.0,
                part,
                offset,
            }));
        }
    }),
};

/// Short bursts of an oscillation on one channel, from a loose contact.
pub(crate) const BURSTS: Effect = Effect {
    name: "bursts",
    typical: "bursts of 0.3 s on one channel, 15 % of the reading at nominal load, every 5 s",
    apply: Apply::Gauges(Scope::One, |gauges, dose| {
        for gauge in gauges {
            let count = (dose.duration_s / 5.0).ceil() as usize;
            let mut starts: Vec<f64> = (0..count)
                .map(|_| dose.draw.recording.random_range(0.0..dose.duration_s))
                .collect();
            starts.sort_by(f64::total_cmp);
            gauge.disturbances.push(Box::new(Bursts {
                starts,
                next: 0,
                amplitude: 0.15 * dose.strength * gauge.span(),
            }));
        }
    }),
};

/// Some time in the middle half of the recording [s].
fn middle(dose: &mut Dose) -> f64 {
    dose.duration_s * dose.draw.recording.random_range(0.25..0.75)
}

fn sign(dose: &mut Dose) -> f64 {
    if dose.draw.individual.random() {
        1.0
    } else {
        -1.0
    }
}

struct Change {
    at: f64,
    jump: f64,
    part: f64,
    offset: f64,
}

impl Disturbance for Change {
    fn apply(&mut self, moment: &Moment, reading: f64) -> f64 {
        if moment.t < self.at {
            reading
        } else {
            self.offset + (reading - self.offset) * (1.0 + self.part) + self.jump
        }
    }
}

struct Bursts {
    starts: Vec<f64>,
    next: usize,
    amplitude: f64,
}

impl Disturbance for Bursts {
    fn apply(&mut self, moment: &Moment, reading: f64) -> f64 {
        /// Length of a burst [s].
        const LONG_S: f64 = 0.3;
        while self
            .starts
            .get(self.next)
            .is_some_and(|start| start + LONG_S <= moment.t)
        {
            self.next += 1;
        }
        match self.starts.get(self.next) {
            Some(start) if *start <= moment.t => {
                let since = moment.t - start;
                let window = (std::f64::consts::PI * since / LONG_S).sin();
                reading + self.amplitude * window * (std::f64::consts::TAU * 23.0 * since).sin()
            }
            _ => reading,
        }
    }
}
