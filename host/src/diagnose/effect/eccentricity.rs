//! An encoder disc that is not centred.

use super::order::waves;
use super::{Coupling, Effect, Linear, Shape};
use crate::diagnose::stream::{Kind, Session, Term};

/// `a (cos(r angle) - cos(r home)) + b (sin(r angle) - sin(r home))` on the angle
/// of an inertia with speed ratio `r`; the index pulse takes the error at home.
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
    fn is_linear(&self) -> bool {
        false
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        self.terms_about(session, shape, &[])
    }
    fn terms_about(&self, session: &Session, shape: &[f64], parameters: &[Vec<f64>]) -> Vec<Term> {
        let (body, signals) = (shape[0] as usize, &session.signals);
        let home = signals.ratios[body] * signals.home;
        let [cosine, sine] = waves(session, signals.ratios[body]);
        let less = |wave: &[f64], home: f64| wave.iter().map(|u| u - home).collect::<Vec<f64>>();
        let waves = [less(&cosine, home.cos()), less(&sine, home.sin())];
        let now = parameters.iter().find(|p| !p.is_empty());
        let about: Vec<f64> = waves[0]
            .iter()
            .zip(&waves[1])
            .map(|(c, s)| now.map_or(0.0, |p| p[0] * c + p[1] * s))
            .collect();
        waves
            .map(|u| Term::Angle {
                body,
                u,
                about: about.clone(),
            })
            .into()
    }
    fn experiment(&self) -> &'static str {
        "constant speed over many turns with a second encoder"
    }
}
