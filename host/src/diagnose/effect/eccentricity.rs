//! An encoder disc that is not centred.

use super::order::waves;
use super::{Coupling, Effect, Linear, Shape};
use crate::diagnose::stream::{Kind, Session, Term};

/// `a cos(r angle) + b sin(r angle)` on the angle of an inertia with speed ratio `r`.
pub struct Eccentricity;

impl Effect for Eccentricity {
    fn name(&self) -> &'static str {
        "encoder-eccentricity"
    }
    fn about(&self) -> &'static str {
        "an encoder errs once per turn"
    }
    fn coupling(&self) -> Coupling {
        Coupling::Shared
    }
    fn linear(&self) -> &'static [Linear] {
        &[
            Linear {
                name: "cosine [rad of the main shaft]",
                prior_std: 0.005,
            },
            Linear {
                name: "sine [rad of the main shaft]",
                prior_std: 0.005,
            },
        ]
    }
    fn shape(&self) -> &'static [Shape] {
        &[Shape {
            name: "inertia",
            unit: "number",
            bounds: (0.0, 6.0),
            step: 0.0,
            logarithmic: false,
        }]
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        let mut bodies: Vec<usize> = session
            .streams
            .iter()
            .filter(|s| s.kind == Kind::Angle)
            .flat_map(|s| s.inertias)
            .collect();
        bodies.sort_unstable();
        bodies.dedup();
        bodies.iter().map(|b| vec![*b as f64]).collect()
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        let body = shape[0] as usize;
        waves(session, session.signals.ratios[body])
            .map(|u| Term::Angle { body, u })
            .into()
    }
    fn experiment(&self) -> &'static str {
        "constant speed over many turns with a second encoder"
    }
}
