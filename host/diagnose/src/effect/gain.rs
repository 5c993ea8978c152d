//! Responses that are not those described.

use super::{Effect, GaugeModel, Linear, Shape, each, one_shape};
use crate::stream::{Session, Stream, Term, product};

/// `reading g`: gauge factor, lead resistance.
pub struct GainError;

impl Effect for GainError {
    fn name(&self) -> &'static str {
        "gain-error"
    }
    fn about(&self) -> &'static str {
        "a channel responds more or less than described"
    }
    fn linear(&self) -> &'static [Linear] {
        &[Linear {
            name: "part of the reading",
            prior_std: 0.1,
        }]
    }
    fn grid(&self, _: &Session) -> Vec<Vec<f64>> {
        one_shape()
    }
    fn terms(&self, session: &Session, _: &[f64]) -> Vec<Term> {
        vec![Term::Gain(vec![1.0; session.signals.len()])]
    }
    fn mend(&self, _: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        gauge.map.iter_mut().for_each(|m| *m *= 1.0 + parameters[0]);
        true
    }
    fn experiment(&self) -> &'static str {
        "torque ramps between no load and nominal load at constant speed"
    }
}

/// `(1 + g) reading(angle - s) - reading(angle)`: a gauge that sits elsewhere,
/// where the strain has another phase and another size.
pub struct Position;

impl Effect for Position {
    fn name(&self) -> &'static str {
        "gauge-position"
    }
    fn about(&self) -> &'static str {
        "a gauge sits at another angle of the carrier"
    }
    fn linear(&self) -> &'static [Linear] {
        &[
            Linear {
                name: "angle [rad]",
                prior_std: 0.02,
            },
            Linear {
                name: "part of the reading",
                prior_std: 0.05,
            },
        ]
    }
    fn grid(&self, _: &Session) -> Vec<Vec<f64>> {
        one_shape()
    }
    fn acts_on(&self, stream: &Stream) -> bool {
        stream.over_angle()
    }
    fn is_linear(&self) -> bool {
        false
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        self.terms_about(session, shape, &[])
    }
    fn terms_about(&self, session: &Session, _: &[f64], parameters: &[Vec<f64>]) -> Vec<Term> {
        let (turned, larger) = session
            .streams
            .iter()
            .enumerate()
            .map(|(k, stream)| {
                let shift = parameters.get(k).and_then(|p| p.first()).copied();
                let shift = shift.unwrap_or(0.0);
                let secant = session.secant(stream, |_| shift);
                let there = stream.reading.iter().zip(&secant);
                (
                    secant.iter().map(|v| -v).collect::<Vec<f64>>(),
                    there.map(|(r, v)| r - shift * v).collect::<Vec<f64>>(),
                )
            })
            .unzip();
        vec![Term::Each(turned), Term::Each(larger)]
    }
    fn mend(&self, _: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        let map = gauge.map.clone();
        let n = map.len();
        let turned = |angle: f64| {
            let position = (angle / std::f64::consts::TAU).rem_euclid(1.0) * n as f64;
            let left = position as usize % n;
            map[left] + position.fract() * (map[(left + 1) % n] - map[left])
        };
        if n > 1 {
            gauge.over_angle(|_, angle| (1.0 + parameters[1]) * turned(angle - parameters[0]));
        }
        true
    }
    fn experiment(&self) -> &'static str {
        "constant torque over several turns of the carrier at two speeds"
    }
}

/// Torque, part of nominal, that counts as one way.
const BOTH_WAYS: f64 = 0.1;

/// `reading level g` or `reading |level| g`: a response that grows or falls with torque.
pub struct Nonlinearity;

impl Effect for Nonlinearity {
    fn name(&self) -> &'static str {
        "strain-nonlinearity"
    }
    fn about(&self) -> &'static str {
        "strain is not in proportion to torque"
    }
    fn linear(&self) -> &'static [Linear] {
        &[Linear {
            name: "part of the reading at nominal torque",
            prior_std: 0.1,
        }]
    }
    fn shape(&self) -> &'static [Shape] {
        &[Shape {
            name: "alike both ways",
            unit: "0 or 1",
            bounds: (0.0, 1.0),
            step: 0.0,
            logarithmic: false,
        }]
    }
    fn numbers(&self) -> usize {
        self.linear().len()
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        let level = &session.signals.level;
        let reaches = |sign: f64| level.iter().any(|level| sign * level > BOTH_WAYS);
        if reaches(1.0) && reaches(-1.0) {
            each(&[0.0, 1.0])
        } else {
            each(&[0.0])
        }
    }
    /// Hardly any is a parabola.
    fn form(&self, _: &Session) -> f64 {
        0.25
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        let level = session.signals.level.iter();
        let level: Vec<f64> = if shape[0] == 0.0 {
            level.copied().collect()
        } else {
            level.map(|level| level.abs()).collect()
        };
        let column = |s: &Stream| product(&s.reading, &level);
        vec![Term::Each(session.streams.iter().map(column).collect())]
    }
    fn mend(&self, shape: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        if shape[0] != 0.0 {
            return false;
        }
        gauge.nonlinearity += parameters[0];
        true
    }
    fn experiment(&self) -> &'static str {
        "slow torque ramps through zero to both ends"
    }
}
