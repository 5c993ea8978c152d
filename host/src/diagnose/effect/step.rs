//! What happens to a gauge at a moment.

use super::{Effect, GaugeModel, Linear, Shape, each};
use crate::diagnose::stream::{Session, Term};

/// Moments that are tried first.
const MOMENTS: usize = 60;

const MOMENT: Shape = Shape {
    name: "moment",
    unit: "s",
    bounds: (0.0, f64::INFINITY),
    step: 0.5,
    logarithmic: false,
};

/// `scale a` after a moment.
pub struct Step;

impl Effect for Step {
    fn name(&self) -> &'static str {
        "gauge-step"
    }
    fn about(&self) -> &'static str {
        "the zero of a channel jumps"
    }
    fn linear(&self) -> &'static [Linear] {
        &[Linear {
            name: "part of full scale",
            prior_std: 0.3,
        }]
    }
    fn shape(&self) -> &'static [Shape] {
        &[MOMENT]
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        moments(session)
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        vec![Term::Zero(after(session, shape[0]))]
    }
    /// The zero as it is since then.
    fn gauge(&self, _: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        gauge.offset += parameters[0] * gauge.full_scale;
        true
    }
    fn experiment(&self) -> &'static str {
        "zero and shunt calibration of the channel, then the same run again"
    }
}

/// `reading a` after a moment.
pub struct Debonding;

impl Effect for Debonding {
    fn name(&self) -> &'static str {
        "gauge-debonding"
    }
    fn about(&self) -> &'static str {
        "a gauge loses part of its response at a moment"
    }
    fn linear(&self) -> &'static [Linear] {
        &[Linear {
            name: "part of the reading",
            prior_std: 0.3,
        }]
    }
    fn shape(&self) -> &'static [Shape] {
        &[MOMENT]
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        moments(session)
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        vec![Term::Gain(after(session, shape[0]))]
    }
    /// The response as it is since then.
    fn gauge(&self, _: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        gauge.map.iter_mut().for_each(|m| *m *= 1.0 + parameters[0]);
        true
    }
    fn experiment(&self) -> &'static str {
        "the same torque ramp twice"
    }
}

fn moments(session: &Session) -> Vec<Vec<f64>> {
    let t = &session.signals.t;
    let (first, last) = (t[0], t[t.len() - 1]);
    // A step in the first or last part is an offset for most of the recording.
    let part = |i: usize| (i as f64 + 1.0) / (MOMENTS as f64 + 1.0);
    let values: Vec<f64> = (0..MOMENTS)
        .map(|i| first + (last - first) * part(i))
        .collect();
    each(&values)
}

fn after(session: &Session, moment: f64) -> Vec<f64> {
    let t = &session.signals.t;
    t.iter()
        .map(|t| f64::from(u8::from(*t >= moment)))
        .collect()
}
