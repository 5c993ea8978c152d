//! A gear between two inertias whose own motion the model lacks.

use super::torsion::SHAFT;
use super::{Coupling, Effect, Linear, Shape};
use crate::diagnose::stream::{Session, Term};

/// What the shafts carry with a gear between two inertias, less what they carry
/// without: the description puts its inertia into the neighbours. The gauges'
/// mesh is behind the gear; nothing changes in the balance.
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
            name: "part of what a gear of that inertia does",
            prior_std: 1.0,
        }]
    }
    fn shape(&self) -> &'static [Shape] {
        &[
            SHAFT,
            Shape {
                name: "inertia",
                unit: "part of the smaller neighbour's",
                bounds: (0.002, 0.9),
                step: 0.25,
                logarithmic: true,
            },
        ]
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        const PARTS: [f64; 8] = [0.01, 0.03, 0.06, 0.1, 0.16, 0.22, 0.3, 0.4];
        let Some(response) = &session.signals.response else {
            return Vec::new();
        };
        (0..response.side.len())
            .flat_map(|s| PARTS.map(|part| vec![s as f64, part]))
            .collect()
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        let signals = &session.signals;
        let Some(response) = &signals.response else {
            return Vec::new();
        };
        let (s, part) = (shape[0] as usize, shape[1]);
        let moment = part * response.bodies[s].0.min(response.bodies[s + 1].0);
        let mut with = response.driven.with_gear(s, part).carried();
        // As one shaft, whose torque is that behind the gear.
        with.torque.remove(s);
        let before = with.twist.remove(s);
        for (twist, before) in with.twist[s].iter_mut().zip(before) {
            *twist += before;
        }
        let mut change = with.less(&response.carried);
        // The slow part is what the loads of one side tell without the gear.
        let sign = if response.side[s][s + 1] == 0.0 {
            0.5
        } else {
            -0.5
        };
        for torque in &mut change.torque {
            *torque = signals.fast(torque);
        }
        for (torque, a) in change.torque[s].iter_mut().zip(&signals.acceleration) {
            *torque += sign * moment * a;
        }
        vec![Term::Chain(change)]
    }
    /// What vibrates a little faster is soon out of step.
    fn form(&self, _: &Session) -> f64 {
        0.4
    }
    fn experiment(&self) -> &'static str {
        "a torque sweep up to the highest torsional mode"
    }
}
