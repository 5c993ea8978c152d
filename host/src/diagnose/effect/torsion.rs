//! What shafts and meshes do beyond a linear spring.

use super::order::waves;
use super::{Coupling, Effect, Linear, Shape};
use crate::diagnose::stream::{Kind, Session, Stream, Term};

/// Lost motion: the twist jumps by the play as the torque changes its sign,
/// `a/2 level / sqrt(level^2 + width^2)`.
pub struct Backlash;

impl Effect for Backlash {
    fn name(&self) -> &'static str {
        "backlash"
    }
    fn about(&self) -> &'static str {
        "a mesh has play: the twist jumps as torque changes its sign"
    }
    fn coupling(&self) -> Coupling {
        Coupling::Shared
    }
    fn linear(&self) -> &'static [Linear] {
        &[Linear {
            name: "play, part of the twist at nominal torque",
            prior_std: 1.0,
        }]
    }
    fn shape(&self) -> &'static [Shape] {
        &[
            Shape {
                name: "shaft",
                unit: "number",
                bounds: (0.0, 6.0),
                step: 0.0,
                logarithmic: false,
            },
            Shape {
                name: "level over which the flank changes",
                unit: "part of nominal",
                bounds: (1e-4, 0.1),
                step: 0.7,
                logarithmic: true,
            },
        ]
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        (0..session.twist.len())
            .flat_map(|i| [0.002, 0.01].map(|width| vec![i as f64, width]))
            .collect()
    }
    fn acts_on(&self, stream: &Stream) -> bool {
        stream.kind == Kind::Angle
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        let flank = |l: &f64| 0.5 * l / (l * l + shape[1] * shape[1]).sqrt();
        vec![Term::Twist {
            shaft: shape[0] as usize,
            u: session.signals.level.iter().map(flank).collect(),
        }]
    }
    fn experiment(&self) -> &'static str {
        "torque through zero both ways at low speed, with an encoder at both ends"
    }
}

/// `a cos(k angle) + b sin(k angle)` on one inertia: cogging.
pub struct Ripple;

impl Effect for Ripple {
    fn name(&self) -> &'static str {
        "torque-ripple"
    }
    fn about(&self) -> &'static str {
        "a torque that depends on the angle (cogging)"
    }
    fn coupling(&self) -> Coupling {
        Coupling::Shared
    }
    fn linear(&self) -> &'static [Linear] {
        &[
            Linear {
                name: "cosine, part of nominal torque",
                prior_std: 0.05,
            },
            Linear {
                name: "sine, part of nominal torque",
                prior_std: 0.05,
            },
        ]
    }
    fn shape(&self) -> &'static [Shape] {
        &[
            Shape {
                name: "inertia",
                unit: "number",
                bounds: (0.0, 6.0),
                step: 0.0,
                logarithmic: false,
            },
            Shape {
                name: "order",
                unit: "per turn of the main shaft",
                bounds: (1.0, 48.0),
                step: 0.0,
                logarithmic: false,
            },
        ]
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        if session.signals.response.is_none() {
            return Vec::new();
        }
        let bodies = session.signals.inertias.len();
        (0..bodies)
            .flat_map(|body| (1..=30).map(move |k| vec![body as f64, f64::from(k)]))
            .collect()
    }
    fn acts_on(&self, stream: &Stream) -> bool {
        stream.kind != Kind::Angle
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        waves(session, shape[1])
            .map(|u| Term::Brake {
                body: shape[0] as usize,
                u,
                fast: true,
            })
            .into()
    }
    fn experiment(&self) -> &'static str {
        "slow turning at constant speed without load over several turns"
    }
}
