//! Torques that brake an inertia and that the model lacks.

use super::{Coupling, Effect, Linear, Shape};
use crate::diagnose::stream::{Kind, Session, Stream, Term};

const TORQUE: &[Linear] = &[Linear {
    name: "part of nominal torque",
    prior_std: 0.1,
}];

const BODY: Shape = Shape {
    name: "inertia",
    unit: "number",
    bounds: (0.0, 6.0),
    step: 0.0,
    logarithmic: false,
};

/// Speeds below this part of nominal count as standstill: friction is as
/// steep there as the encoder resolves.
const CREEP: f64 = 0.003;

fn direction(w: f64) -> f64 {
    w / (w * w + CREEP * CREEP).sqrt()
}

fn brake(session: &Session, shape: &[f64], torque: impl Fn(f64, f64) -> f64) -> Vec<Term> {
    let signals = &session.signals;
    let u = signals
        .relative_speed()
        .zip(&signals.level)
        .map(|(w, l)| torque(w, *l))
        .collect();
    vec![Term::Brake {
        body: shape[0] as usize,
        u,
        fast: false,
    }]
}

fn bodies(session: &Session) -> Vec<Vec<f64>> {
    if session.streams.iter().any(|s| s.kind == Kind::Balance) {
        (0..session.signals.inertias.len())
            .map(|i| vec![i as f64])
            .collect()
    } else {
        Vec::new()
    }
}

fn with_body(session: &Session, values: &[f64]) -> Vec<Vec<f64>> {
    bodies(session)
        .iter()
        .flat_map(|b| values.iter().map(|v| vec![b[0], *v]))
        .collect()
}

fn no_angle(stream: &Stream) -> bool {
    stream.kind != Kind::Angle
}

/// `a sign(w)`.
pub struct Coulomb;

impl Effect for Coulomb {
    fn name(&self) -> &'static str {
        "coulomb-friction"
    }
    fn about(&self) -> &'static str {
        "a torque that brakes with the same size at every speed"
    }
    fn coupling(&self) -> Coupling {
        Coupling::Shared
    }
    fn linear(&self) -> &'static [Linear] {
        TORQUE
    }
    fn shape(&self) -> &'static [Shape] {
        &[BODY]
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        bodies(session)
    }
    fn acts_on(&self, stream: &Stream) -> bool {
        no_angle(stream)
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        brake(session, shape, |w, _| direction(w))
    }
    fn experiment(&self) -> &'static str {
        "slow turning both ways without load, with standstill between"
    }
}

/// `a exp(-|w| / ws) sign(w)`: what sticking adds near standstill.
pub struct Stribeck;

impl Effect for Stribeck {
    fn name(&self) -> &'static str {
        "stribeck-friction"
    }
    fn about(&self) -> &'static str {
        "a torque that brakes near standstill and fades with speed"
    }
    fn coupling(&self) -> Coupling {
        Coupling::Shared
    }
    fn linear(&self) -> &'static [Linear] {
        TORQUE
    }
    fn shape(&self) -> &'static [Shape] {
        &[
            BODY,
            Shape {
                name: "speed over which it fades",
                unit: "part of nominal",
                bounds: (0.01, 0.5),
                step: 0.3,
                logarithmic: true,
            },
        ]
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        with_body(session, &[0.02, 0.05, 0.12, 0.3])
    }
    fn acts_on(&self, stream: &Stream) -> bool {
        no_angle(stream)
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        brake(session, shape, |w, _| {
            direction(w) * (-(w.abs() / shape[1]).powf(1.5)).exp()
        })
    }
    fn experiment(&self) -> &'static str {
        "very slow starts and stops both ways"
    }
}

/// `a w`.
pub struct Viscous;

impl Effect for Viscous {
    fn name(&self) -> &'static str {
        "viscous-friction"
    }
    fn about(&self) -> &'static str {
        "a torque that brakes in proportion to speed"
    }
    fn coupling(&self) -> Coupling {
        Coupling::Shared
    }
    fn linear(&self) -> &'static [Linear] {
        TORQUE
    }
    fn shape(&self) -> &'static [Shape] {
        &[BODY]
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        bodies(session)
    }
    fn acts_on(&self, stream: &Stream) -> bool {
        no_angle(stream)
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        brake(session, shape, |w, _| w)
    }
    fn drag(&self, shape: &[f64], parameters: &[f64]) -> Option<(usize, f64)> {
        Some((shape[0] as usize, parameters[0]))
    }
    fn experiment(&self) -> &'static str {
        "several speeds without load"
    }
}

/// `a |level| sign(w)`: what a mesh loses of what it carries.
pub struct LoadDependent;

impl Effect for LoadDependent {
    fn name(&self) -> &'static str {
        "load-friction"
    }
    fn about(&self) -> &'static str {
        "a mesh loses a part of the torque that it carries"
    }
    fn coupling(&self) -> Coupling {
        Coupling::Shared
    }
    fn linear(&self) -> &'static [Linear] {
        TORQUE
    }
    fn shape(&self) -> &'static [Shape] {
        &[BODY]
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        bodies(session)
    }
    fn acts_on(&self, stream: &Stream) -> bool {
        no_angle(stream)
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        brake(session, shape, |w, l| l.abs() * direction(w))
    }
    fn experiment(&self) -> &'static str {
        "torque ramps at constant speed, both ways"
    }
}

/// Friction that builds up over an angle: `du = (d(angle) - |d(angle)| u) / width`
/// (Dahl; Bouc-Wen with exponent 1).
pub struct Presliding;

impl Effect for Presliding {
    fn name(&self) -> &'static str {
        "presliding-hysteresis"
    }
    fn about(&self) -> &'static str {
        "friction that builds up over an angle and stays at standstill"
    }
    fn coupling(&self) -> Coupling {
        Coupling::Shared
    }
    fn linear(&self) -> &'static [Linear] {
        TORQUE
    }
    fn shape(&self) -> &'static [Shape] {
        &[
            BODY,
            Shape {
                name: "angle over which it builds up",
                unit: "rad of the main shaft",
                bounds: (1e-4, 2.0),
                step: 0.5,
                logarithmic: true,
            },
        ]
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        with_body(session, &[0.001, 0.005, 0.025, 0.1])
    }
    fn acts_on(&self, stream: &Stream) -> bool {
        no_angle(stream)
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        let angle = &session.signals.angle;
        let mut before = angle.first().copied().unwrap_or(0.0);
        // Where it came from is not known: from the first turning.
        let mut z = direction(session.signals.speed[0] / session.signals.nominal_speed);
        let mut u = Vec::with_capacity(angle.len());
        for a in angle {
            let step = (a - before) / shape[1];
            before = *a;
            // Exact for a step of one sign: it tends to the sign of the motion.
            z = step.signum() + (z - step.signum()) * (-step.abs()).exp();
            u.push(z);
        }
        vec![Term::Brake {
            body: shape[0] as usize,
            u,
            fast: false,
        }]
    }
    fn experiment(&self) -> &'static str {
        "reversals of several sizes at low speed, with standstill between"
    }
}
