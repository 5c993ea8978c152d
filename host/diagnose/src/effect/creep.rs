//! Zeros that remember the load, or wander.

use super::{Effect, GaugeModel, Linear, Shape, each, one_shape};
use crate::stream::{Session, Term};
use loadtwin_machine::{Creep, Hysteresis, lag};

/// `scale a z`, `dz/dt = (level - z) / tau`.
pub struct GaugeCreep;

impl Effect for GaugeCreep {
    fn name(&self) -> &'static str {
        "gauge-creep"
    }
    fn about(&self) -> &'static str {
        "zeros creep with the history of the load"
    }
    fn linear(&self) -> &'static [Linear] {
        &[Linear {
            name: "part of full scale in the end at nominal load",
            prior_std: 0.3,
        }]
    }
    fn shape(&self) -> &'static [Shape] {
        &[Shape {
            name: "time constant",
            unit: "s",
            bounds: (2.0, 400.0),
            step: 0.35,
            logarithmic: true,
        }]
    }
    fn grid(&self, _: &Session) -> Vec<Vec<f64>> {
        each(&[3.0, 6.0, 12.0, 25.0, 50.0, 100.0])
    }
    /// Creep goes on over decades of time, of which one exponential is a part.
    fn form(&self, _: &Session) -> f64 {
        0.3
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        let signals = &session.signals;
        let level = signals.level.iter().copied();
        vec![Term::Zero(lag(level, signals.dt_s, shape[0]))]
    }
    fn mend(&self, shape: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        let is_new = gauge.creep.is_none();
        if is_new {
            gauge.creep = Some(Creep {
                at_nominal: parameters[0] * gauge.full_scale,
                time_s: shape[0],
            });
        }
        is_new
    }
    fn experiment(&self) -> &'static str {
        "a long hold at nominal load and then a long one without load"
    }
}

/// `scale a (t - t0)`.
pub struct Drift;

impl Effect for Drift {
    fn name(&self) -> &'static str {
        "gauge-drift"
    }
    fn about(&self) -> &'static str {
        "a zero drifts with time"
    }
    fn linear(&self) -> &'static [Linear] {
        &[Linear {
            name: "part of full scale per hour",
            prior_std: 10.0,
        }]
    }
    fn grid(&self, _: &Session) -> Vec<Vec<f64>> {
        one_shape()
    }
    /// Hardly any drift is straight.
    fn form(&self, _: &Session) -> f64 {
        0.3
    }
    fn terms(&self, session: &Session, _: &[f64]) -> Vec<Term> {
        let t = &session.signals.t;
        vec![Term::Zero(t.iter().map(|t| t / 3600.0).collect())]
    }
    fn experiment(&self) -> &'static str {
        "standstill without load for as long as the recording"
    }
}

/// Bouc-Wen in the strain: `scale a z`, `dz = (dl - |dl| z) / width` with the level `l`.
pub struct StrainHysteresis;

impl Effect for StrainHysteresis {
    fn name(&self) -> &'static str {
        "strain-hysteresis"
    }
    fn about(&self) -> &'static str {
        "strain depends on the direction from which the load came"
    }
    fn linear(&self) -> &'static [Linear] {
        &[Linear {
            name: "part of full scale, half the width of the loop",
            prior_std: 0.1,
        }]
    }
    fn shape(&self) -> &'static [Shape] {
        &[Shape {
            name: "level over which it turns",
            unit: "part of nominal",
            bounds: (0.02, 1.0),
            step: 0.35,
            logarithmic: true,
        }]
    }
    fn grid(&self, _: &Session) -> Vec<Vec<f64>> {
        each(&[0.05, 0.15, 0.4])
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        let mut z: f64 = 0.0;
        let mut before = session.signals.level.first().copied().unwrap_or(0.0);
        let column = |l: &f64| {
            let step = (l - before) / shape[0];
            before = *l;
            z = (z + step - step.abs() * z).clamp(-1.0, 1.0);
            z
        };
        vec![Term::Zero(
            session.signals.level.iter().map(column).collect(),
        )]
    }
    fn mend(&self, shape: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        let is_new = gauge.hysteresis.is_none();
        if is_new {
            gauge.hysteresis = Some(Hysteresis {
                half_width: parameters[0] * gauge.full_scale,
                level: shape[0],
            });
        }
        is_new
    }
    fn experiment(&self) -> &'static str {
        "torque cycles of several sizes, up and down"
    }
}
