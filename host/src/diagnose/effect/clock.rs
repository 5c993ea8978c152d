//! Channels that do not tell the same time.

use super::{Effect, Linear, Shape, each};
use crate::diagnose::stream::{Kind, Session, Stream, Term};

/// `reading(t - d) - reading(t)`, times 1 where the whole channel is late.
pub struct Delay;

impl Effect for Delay {
    fn name(&self) -> &'static str {
        "channel-delay"
    }
    fn about(&self) -> &'static str {
        "a channel comes late"
    }
    fn linear(&self) -> &'static [Linear] {
        &[Linear {
            name: "part of the reading that is late",
            prior_std: 1.0,
        }]
    }
    fn shape(&self) -> &'static [Shape] {
        &[Shape {
            name: "delay",
            unit: "s",
            bounds: (-0.2, 0.2),
            step: 0.004,
            logarithmic: false,
        }]
    }
    fn grid(&self, _: &Session) -> Vec<Vec<f64>> {
        each(&[-0.03, -0.01, 0.002, 0.006, 0.012, 0.02, 0.03, 0.05])
    }
    fn acts_on(&self, stream: &Stream) -> bool {
        stream.kind == Kind::Strain
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        let late = shape[0] / session.signals.dt_s;
        let column = |s: &Stream| {
            let n = s.reading.len();
            let at = |i: isize| s.reading[i.clamp(0, n as isize - 1) as usize];
            let (whole, part) = (late.floor() as isize, late - late.floor());
            (0..n as isize)
                .map(|i| at(i - whole) * (1.0 - part) + at(i - whole - 1) * part - at(i))
                .collect()
        };
        vec![Term::Each(session.streams.iter().map(column).collect())]
    }
    fn experiment(&self) -> &'static str {
        "steps of torque"
    }
}
