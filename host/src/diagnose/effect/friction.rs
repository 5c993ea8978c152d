//! Torques that brake an inertia and that the model lacks.

use super::{Coupling, Effect, Linear, Shape};
use crate::diagnose::signals::Signals;
use crate::diagnose::stream::{Kind, Session, Stream, Term};

/// Speeds below this part of nominal count as standstill: friction is as
/// steep there as the encoder resolves.
const CREEP: f64 = 0.003;

const BODY: Shape = Shape {
    name: "inertia",
    unit: "number",
    bounds: (0.0, 6.0),
    step: 0.0,
    logarithmic: false,
};

/// A torque that brakes one inertia: `a u`, with `u` by its law.
pub struct Friction {
    name: &'static str,
    about: &'static str,
    experiment: &'static str,
    /// The inertia first, then what the law needs.
    shape: &'static [Shape],
    /// Values of the law's own parameter from which the search starts; none
    /// where it has none.
    starts: &'static [f64],
    /// Torque sample by sample, part of its size.
    law: fn(&Signals, &[f64]) -> Vec<f64>,
    /// Whether it holds the inertia at standstill.
    sticks: bool,
    /// Whether it is a drag in proportion to speed, which the line runs.
    is_drag: bool,
}

/// `a sign(w)`.
pub const COULOMB: Friction = Friction {
    name: "coulomb-friction",
    about: "a torque that brakes with the same size at every speed",
    experiment: "slow turning both ways without load, with standstill between",
    shape: &[BODY],
    starts: &[],
    law: |signals, shape| speed(signals, shape).map(direction).collect(),
    sticks: true,
    is_drag: false,
};

/// `a exp(-(|w| / ws)^1.5) sign(w)`: what sticking adds near standstill.
pub const STRIBECK: Friction = Friction {
    name: "stribeck-friction",
    about: "a torque that brakes near standstill and fades with speed",
    experiment: "very slow starts and stops both ways",
    shape: &[
        BODY,
        Shape {
            name: "speed over which it fades",
            unit: "part of nominal",
            bounds: (0.01, 0.5),
            step: 0.3,
            logarithmic: true,
        },
    ],
    starts: &[0.02, 0.05, 0.12, 0.3],
    law: |signals, shape| {
        let fades = |w: f64| direction(w) * (-(w.abs() / shape[1]).powf(1.5)).exp();
        speed(signals, shape).map(fades).collect()
    },
    sticks: true,
    is_drag: false,
};

/// `a w`.
pub const VISCOUS: Friction = Friction {
    name: "viscous-friction",
    about: "a torque that brakes in proportion to speed",
    experiment: "several speeds without load",
    shape: &[BODY],
    starts: &[],
    law: |signals, shape| speed(signals, shape).collect(),
    sticks: false,
    is_drag: true,
};

/// `a |level| sign(w)`: what a mesh loses of what it carries.
pub const LOAD_DEPENDENT: Friction = Friction {
    name: "load-friction",
    about: "a mesh loses a part of the torque that it carries",
    experiment: "torque ramps at constant speed, both ways",
    shape: &[BODY],
    starts: &[],
    law: |signals, shape| {
        speed(signals, shape)
            .zip(&signals.level)
            .map(|(w, level)| level.abs() * direction(w))
            .collect()
    },
    sticks: false,
    is_drag: false,
};

/// Friction that builds up over an angle: `du = (d(angle) - |d(angle)| u) / width`
/// (Dahl; Bouc-Wen with exponent 1).
pub const PRESLIDING: Friction = Friction {
    name: "presliding-hysteresis",
    about: "friction that builds up over an angle and stays at standstill",
    experiment: "reversals of several sizes at low speed, with standstill between",
    shape: &[
        BODY,
        Shape {
            name: "angle over which it builds up",
            unit: "rad of the main shaft",
            bounds: (1e-4, 2.0),
            step: 0.5,
            logarithmic: true,
        },
    ],
    starts: &[0.001, 0.005, 0.025, 0.1],
    law: presliding,
    sticks: true,
    is_drag: false,
};

impl Effect for Friction {
    fn name(&self) -> &'static str {
        self.name
    }
    fn about(&self) -> &'static str {
        self.about
    }
    fn coupling(&self) -> Coupling {
        Coupling::Shared
    }
    fn linear(&self) -> &'static [Linear] {
        &[Linear {
            name: "part of nominal torque",
            prior_std: 0.1,
        }]
    }
    fn shape(&self) -> &'static [Shape] {
        self.shape
    }
    /// Each inertia with each start, where the torque balance is known.
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        if !session.streams.iter().any(|s| s.kind == Kind::Balance) {
            return Vec::new();
        }
        (0..session.signals.inertias.len())
            .map(|body| body as f64)
            .flat_map(|body| match self.starts {
                [] => vec![vec![body]],
                starts => starts.iter().map(|start| vec![body, *start]).collect(),
            })
            .collect()
    }
    fn acts_on(&self, stream: &Stream) -> bool {
        stream.kind != Kind::Angle
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        vec![Term::Brake {
            body: shape[0] as usize,
            u: (self.law)(&session.signals, shape),
            sticks: self.sticks,
        }]
    }
    fn drag(&self, shape: &[f64], parameters: &[f64]) -> Option<(usize, f64)> {
        self.is_drag.then(|| (shape[0] as usize, parameters[0]))
    }
    fn experiment(&self) -> &'static str {
        self.experiment
    }
}

/// Speed of the inertia that is braked, part of nominal.
fn speed(signals: &Signals, shape: &[f64]) -> impl Iterator<Item = f64> {
    signals.vibrating_speed(shape[0] as usize)
}

fn direction(w: f64) -> f64 {
    w / (w * w + CREEP * CREEP).sqrt()
}

fn presliding(signals: &Signals, shape: &[f64]) -> Vec<f64> {
    let turned = signals.nominal_speed * signals.dt_s;
    // Where it came from is not known: from the first turning.
    let mut z = speed(signals, shape).next().map_or(0.0, direction);
    speed(signals, shape)
        .map(|w| {
            let step = w * turned / shape[1];
            // Exact for a step of one sign: it tends to the sign of the motion.
            z = step.signum() + (z - step.signum()) * (-step.abs()).exp();
            z
        })
        .collect()
}
