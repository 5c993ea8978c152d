//! Zeros and responses that move with temperature.

use super::{Effect, GaugeModel, Linear, Shape, each};
use crate::stream::{Session, Term};
use loadtwin_machine::{Machine, Thermal, followed, lag};

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

/// What warmth does to a gauge, by `w` with `dw/dt = (T - T0 - w) / lag`.
pub struct Warmth {
    name: &'static str,
    about: &'static str,
    experiment: &'static str,
    size: &'static [Linear],
    /// What changes with `w`.
    term: fn(Vec<f64>) -> Term,
    /// Takes its size into what warmth does to a gauge of that full scale.
    mend: fn(&mut Thermal, f64, f64),
}

/// `scale a w`.
pub const DRIFT: Warmth = Warmth {
    name: "thermal-drift",
    about: "zeros move with the recorded temperature",
    experiment: "warming up and cooling down without load",
    size: &[Linear {
        name: "part of full scale per kelvin",
        prior_std: 0.05,
    }],
    term: Term::Zero,
    mend: |thermal, size, full_scale| thermal.zero_per_k += size * full_scale,
};

/// `reading a w`.
pub const GAIN: Warmth = Warmth {
    name: "thermal-gain",
    about: "responses change with the recorded temperature",
    experiment: "the same torque ramp, cold and warm",
    size: &[Linear {
        name: "part of the reading per kelvin",
        prior_std: 0.05,
    }],
    term: Term::Gain,
    mend: |thermal, size, _| thermal.gain_per_k += size,
};

impl Effect for Warmth {
    fn name(&self) -> &'static str {
        self.name
    }
    fn about(&self) -> &'static str {
        self.about
    }
    fn linear(&self) -> &'static [Linear] {
        self.size
    }
    fn shape(&self) -> &'static [Shape] {
        &[LAG]
    }
    fn numbers(&self) -> usize {
        self.linear().len()
    }
    /// Lags, where a temperature was recorded.
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        match &session.signals.warming {
            Some(_) => each(&[AT_ONCE_S, 4.0, 12.0, 40.0]),
            None => Vec::new(),
        }
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        let signals = &session.signals;
        let measured = signals.warming.iter().flatten().copied();
        vec![(self.term)(followed(measured, signals.dt_s, shape[0]))]
    }
    /// The temperature where zeros hold may be off by the noise of one reading.
    fn nuisances(&self, session: &Session, _: &[f64]) -> Vec<Term> {
        let signals = &session.signals;
        let off = self.size[0].prior_std * signals.zero_noise_k;
        vec![(self.term)(vec![off; signals.len()])]
    }
    fn mend(&self, _: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        let sampled = gauge.thermal.as_mut();
        sampled
            .map(|thermal| (self.mend)(thermal, parameters[0], gauge.full_scale))
            .is_some()
    }
    /// Two lags, one after the other, are one as long as both: that described and the longest found.
    fn mend_machine(
        &self,
        session: &Session,
        shape: &[f64],
        _: &[f64],
        machine: &mut Machine,
    ) -> bool {
        let sampled = machine.thermometer_mut().filter(|t| t.adc.is_some());
        let later = if shape[0] > AT_ONCE_S { shape[0] } else { 0.0 };
        let both = session.signals.lag_s + later;
        sampled.map(|t| t.lag_s = t.lag_s.max(both)).is_some()
    }
    fn experiment(&self) -> &'static str {
        self.experiment
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
