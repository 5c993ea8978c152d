//! Zeros and responses that move with temperature.

use super::{Effect, GaugeModel, Linear, Shape, each};
use crate::diagnose::stream::{Session, Term};
use crate::machine::{Machine, followed, lag};

/// How slowly gauges follow the thermometer, which sits elsewhere.
const LAG: Shape = Shape {
    name: "time in which gauges follow",
    unit: "s",
    bounds: (AT_ONCE_S, 300.0),
    step: 0.5,
    logarithmic: true,
};

/// A lag that nothing tells from none [s].
const AT_ONCE_S: f64 = 0.3;

/// `scale a w`, `dw/dt = (T - T0 - w) / lag`.
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
    fn shape(&self) -> &'static [Shape] {
        &[LAG]
    }
    fn numbers(&self) -> usize {
        self.linear().len()
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        recorded(session)
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        vec![Term::Zero(warming(session, shape[0]))]
    }
    fn mend(&self, _: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        let zero_per_k = parameters[0] * gauge.full_scale;
        let sampled = gauge.thermal.as_mut();
        sampled.map(|t| t.zero_per_k += zero_per_k).is_some()
    }
    fn mend_machine(&self, _: &Session, shape: &[f64], _: &[f64], machine: &mut Machine) -> bool {
        follows(machine, shape[0])
    }
    fn experiment(&self) -> &'static str {
        "warming up and cooling down without load"
    }
}

/// `reading a w`, with `w` as of [`Drift`].
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
    fn shape(&self) -> &'static [Shape] {
        &[LAG]
    }
    fn numbers(&self) -> usize {
        self.linear().len()
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        recorded(session)
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        vec![Term::Gain(warming(session, shape[0]))]
    }
    fn mend(&self, _: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        let sampled = gauge.thermal.as_mut();
        sampled.map(|t| t.gain_per_k += parameters[0]).is_some()
    }
    fn mend_machine(&self, _: &Session, shape: &[f64], _: &[f64], machine: &mut Machine) -> bool {
        follows(machine, shape[0])
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

/// Lags, where a temperature was recorded.
fn recorded(session: &Session) -> Vec<Vec<f64>> {
    match &session.signals.warming {
        Some(_) => each(&[AT_ONCE_S, 4.0, 12.0, 40.0]),
        None => Vec::new(),
    }
}

/// How much warmer the gauges are [K], where they follow the thermometer in `lag_s`.
fn warming(session: &Session, lag_s: f64) -> Vec<f64> {
    let signals = &session.signals;
    let measured = signals.warming.iter().flatten().copied();
    followed(measured, signals.dt_s, lag_s)
}

/// Takes it into the description that gauges follow `lag_s` more slowly: two lags, one after the
/// other, are one as long as both. False where the board has no thermometer.
fn follows(machine: &mut Machine, lag_s: f64) -> bool {
    let sampled = machine.thermometer_mut().filter(|t| t.adc.is_some());
    let later = if lag_s > AT_ONCE_S { lag_s } else { 0.0 };
    sampled.map(|t| t.lag_s += later).is_some()
}
