//! A gear between two inertias whose own motion the model lacks.

use super::{Coupling, Effect, Linear, one_shape};
use crate::diagnose::stream::{Kind, Session, Stream, Term};

/// `-map a J dw/dt / 2`: inertia that the description puts into the neighbours
/// sits between them, before the gauges' mesh; it stays in the balance.
pub struct Resonance;

impl Effect for Resonance {
    fn name(&self) -> &'static str {
        "torsional-resonance"
    }
    fn about(&self) -> &'static str {
        "a gear between two inertias vibrates by itself"
    }
    fn coupling(&self) -> Coupling {
        Coupling::Shared
    }
    fn linear(&self) -> &'static [Linear] {
        &[Linear {
            name: "part of the smaller neighbour's inertia",
            prior_std: 0.3,
        }]
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        match session.signals.response {
            Some(_) => one_shape(),
            None => Vec::new(),
        }
    }
    fn acts_on(&self, stream: &Stream) -> bool {
        stream.kind == Kind::Strain
    }
    fn terms(&self, session: &Session, _: &[f64]) -> Vec<Term> {
        let Some(response) = &session.signals.response else {
            return Vec::new();
        };
        let column = |s: &Stream| {
            let Some(shaft) = s.shaft else {
                return Vec::new();
            };
            let moment = response.bodies[shaft].0.min(response.bodies[shaft + 1].0);
            // The mesh is behind the gear: seen from the other side the sign turns.
            let after = response.side[shaft][shaft + 1] != 0.0;
            let half = if after { -0.5 } else { 0.5 } * moment;
            s.map
                .iter()
                .zip(&session.signals.acceleration)
                .map(|(m, a)| half * m * a)
                .collect()
        };
        vec![Term::Each(session.streams.iter().map(column).collect())]
    }
    fn experiment(&self) -> &'static str {
        "a torque sweep up to the highest torsional mode"
    }
}
