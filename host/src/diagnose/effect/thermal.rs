//! Zeros and responses that move with temperature.

use super::{Effect, GaugeModel, Linear, Shape, each, one_shape};
use crate::diagnose::stream::{Session, Term};
use crate::machine::lag;

/// `scale a (T - T0)`.
pub struct Drift;

impl Effect for Drift {
    fn name(&self) -> &'static str {
        "thermal-drift"
    }
    fn about(&self) -> &'static str {
        "zeros move with the recorded temperature"
    }
    fn linear(&self) -> &'static [Linear] {
        &[Linear {
            name: "part of full scale per kelvin",
            prior_std: 0.05,
        }]
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        recorded(session)
    }
    fn terms(&self, session: &Session, _: &[f64]) -> Vec<Term> {
        vec![Term::Zero(warming(session))]
    }
    fn mend(&self, _: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        let zero_per_k = parameters[0] * gauge.full_scale;
        let sampled = gauge.thermal.as_mut();
        sampled.map(|t| t.zero_per_k += zero_per_k).is_some()
    }
    fn experiment(&self) -> &'static str {
        "warming up and cooling down without load"
    }
}

/// `reading a (T - T0)`.
pub struct Gain;

impl Effect for Gain {
    fn name(&self) -> &'static str {
        "thermal-gain"
    }
    fn about(&self) -> &'static str {
        "responses change with the recorded temperature"
    }
    fn linear(&self) -> &'static [Linear] {
        &[Linear {
            name: "part of the reading per kelvin",
            prior_std: 0.05,
        }]
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        recorded(session)
    }
    fn terms(&self, session: &Session, _: &[f64]) -> Vec<Term> {
        vec![Term::Gain(warming(session))]
    }
    fn mend(&self, _: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        let sampled = gauge.thermal.as_mut();
        sampled.map(|t| t.gain_per_k += parameters[0]).is_some()
    }
    fn experiment(&self) -> &'static str {
        "the same torque ramp, cold and warm"
    }
}

/// `scale a z`, `dz/dt = (|power| - z) / tau`: what friction and mesh losses
/// heat, where no thermometer is.
pub struct Unrecorded;

const HEATING: Shape = Shape {
    name: "time constant",
    unit: "s",
    bounds: (100.0, 5000.0),
    step: 0.7,
    logarithmic: true,
};

impl Effect for Unrecorded {
    fn name(&self) -> &'static str {
        "thermal-drift-unrecorded"
    }
    fn about(&self) -> &'static str {
        "zeros move with a heating that is not recorded"
    }
    fn linear(&self) -> &'static [Linear] {
        &[Linear {
            name: "part of full scale in the end at nominal power",
            prior_std: 1.0,
        }]
    }
    fn shape(&self) -> &'static [Shape] {
        &[HEATING]
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        if session.signals.warming.is_some() {
            Vec::new()
        } else {
            each(&[200.0, 600.0, 1800.0])
        }
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        let signals = &session.signals;
        let power = signals
            .level
            .iter()
            .zip(signals.relative_speed())
            .map(|(l, w)| (l * w).abs());
        vec![Term::Zero(lag(power, signals.dt_s, shape[0]))]
    }
    fn experiment(&self) -> &'static str {
        "a thermometer at the gauges, or a long run at power and then one without load"
    }
}

fn recorded(session: &Session) -> Vec<Vec<f64>> {
    match &session.signals.warming {
        Some(_) => one_shape(),
        None => Vec::new(),
    }
}

fn warming(session: &Session) -> Vec<f64> {
    session.signals.warming.clone().unwrap_or_default()
}
