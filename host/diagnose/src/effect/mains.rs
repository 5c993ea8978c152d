//! Pick-up from the mains.

use std::f64::consts::TAU;

use super::{Effect, Linear, Shape, each};
use crate::stream::{Kind, Session, Stream, Term};

/// `scale (a cos(2 pi f t) + b sin(2 pi f t))`, `f` near 50 or 60 Hz or twice
/// these; aliased as the samples alias it.
pub struct PickUp;

impl Effect for PickUp {
    fn name(&self) -> &'static str {
        "mains-pick-up"
    }
    fn about(&self) -> &'static str {
        "an oscillation of the mains"
    }
    fn linear(&self) -> &'static [Linear] {
        &[
            Linear {
                name: "cosine, part of full scale",
                prior_std: 0.05,
            },
            Linear {
                name: "sine, part of full scale",
                prior_std: 0.05,
            },
        ]
    }
    fn shape(&self) -> &'static [Shape] {
        &[Shape {
            name: "frequency",
            unit: "Hz",
            bounds: (10.0, 200.0),
            step: 0.003,
            logarithmic: false,
        }]
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        // Grids keep within 0.1 Hz; a step is what the duration resolves.
        let duration = session.signals.dt_s * session.signals.len() as f64;
        let step = (0.4 / duration).max(0.002);
        let count = ((0.1 / step).ceil() as i32).min(40);
        let around = |f: f64| (-count..=count).map(move |i| f + f64::from(i) * step);
        let values: Vec<f64> = [50.0, 60.0].into_iter().flat_map(around).collect();
        each(&values)
    }
    fn acts_on(&self, stream: &Stream) -> bool {
        stream.kind == Kind::Strain
    }
    /// The phase is that of the recording.
    fn lasts(&self) -> bool {
        false
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        let t = &session.signals.t;
        let phase = |t: &f64| TAU * (shape[0] * t).fract();
        vec![
            Term::Zero(t.iter().map(|t| phase(t).cos()).collect()),
            Term::Zero(t.iter().map(|t| phase(t).sin()).collect()),
        ]
    }
    fn experiment(&self) -> &'static str {
        "standstill without load, at twice the sample rate"
    }
}
