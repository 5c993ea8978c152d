//! What shafts and meshes do beyond a linear spring.

use super::order::waves;
use super::{Coupling, Effect, Linear, Shape};
use crate::stream::{Kind, Session, Stream, Term, product};

/// Which shaft an effect is in.
pub(super) const SHAFT: Shape = Shape {
    name: "shaft",
    unit: "number",
    bounds: (0.0, 6.0),
    step: 0.0,
    logarithmic: false,
};

/// Level over which the flank changes where the chain's own response is not
/// known, part of nominal.
const FLANK: f64 = 0.005;

/// Lost motion: what the shafts carry with play in one of them, less what they
/// carry without; where their loads are not known, the twist that jumps by the
/// play as the torque changes its sign.
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
            name: "part of what such a play does",
            prior_std: 1.0,
        }]
    }
    fn shape(&self) -> &'static [Shape] {
        &[
            SHAFT,
            Shape {
                name: "play",
                unit: "part of the twist at nominal torque",
                bounds: (0.002, 2.0),
                step: 0.3,
                logarithmic: true,
            },
        ]
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        // Fine: the play decides on the phase of what vibrates once the flank is met again.
        let plays = (0..20).map(|i| 0.015 * 1.2_f64.powi(i));
        (0..session.twist.len())
            .flat_map(|i| plays.clone().map(move |play| vec![i as f64, play]))
            .collect()
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        let (signals, shaft) = (&session.signals, shape[0] as usize);
        let Some(response) = &signals.response else {
            let flank = |l: &f64| 0.5 * shape[1] * l / l.hypot(FLANK);
            return vec![Term::Twist {
                shaft,
                u: signals.level.iter().map(flank).collect(),
            }];
        };
        let play = shape[1] * session.twist[shaft];
        let driven = response.driven.with_play(shaft, play, &response.carried);
        let mut change = driven.carried().less(&response.carried);
        for torque in &mut change.torque {
            *torque = signals.fast(torque);
        }
        vec![Term::Chain(change)]
    }
    /// When flanks meet decides on the phase of what vibrates then: loads alone tell that roughly.
    fn form(&self, session: &Session) -> f64 {
        let response = session.signals.response.as_ref();
        if response.is_some_and(|r| !r.driven.encoders.is_empty()) {
            0.15
        } else {
            0.35
        }
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
        // What the chain does to a torque is known only as fast as it is sampled.
        let most = 0.8 * std::f64::consts::PI / session.signals.dt_s;
        let seen = |w: &f64| f64::from(u8::from((shape[1] * w).abs() < most));
        let seen: Vec<f64> = session.signals.speed.iter().map(seen).collect();
        waves(session, shape[1])
            .map(|u| Term::Brake {
                body: shape[0] as usize,
                u: product(&u, &seen),
                sticks: false,
            })
            .into()
    }
    fn experiment(&self) -> &'static str {
        "slow turning at constant speed without load over several turns"
    }
}
