//! A bearing that is softer or stiffer.

use super::{RUN_UP, place};
use crate::effect::{Coupling, Effect, Linear, Shape};
use crate::rotor::{Readings, RotorPlace, RotorSession};
use loadtwin_machine::Rotor;

/// Factors on a stiffness from which the search starts.
const FACTORS: [f64; 6] = [0.4, 0.6, 0.8, 1.25, 1.7, 2.5];

/// What a bearing of another stiffness along x and y explains beyond the described one, each with
/// the unbalance that fits it best: by 1 where the stiffness is right.
pub struct BearingStiffness;

const fn factor(name: &'static str) -> Shape {
    Shape {
        name,
        unit: "of the stiffness described",
        bounds: (0.1, 10.0),
        step: 0.15,
        logarithmic: true,
    }
}

impl Effect<RotorSession> for BearingStiffness {
    fn name(&self) -> &'static str {
        "bearing-stiffness"
    }
    fn about(&self) -> &'static str {
        "a bearing is softer or stiffer than described"
    }
    fn coupling(&self) -> Coupling {
        Coupling::Shared
    }
    fn linear(&self) -> &'static [Linear] {
        &[Linear {
            name: "part of what such a bearing explains",
            prior_std: 1.0,
        }]
    }
    fn shape(&self) -> &'static [Shape] {
        const ALL: &[Shape] = &[
            place("bearing", "from 0"),
            factor("along x"),
            factor("along y"),
        ];
        ALL
    }
    fn grid(&self, session: &RotorSession) -> Vec<Vec<f64>> {
        (0..session.rotor().bearings.len())
            .flat_map(|bearing| FACTORS.map(|factor| vec![bearing as f64, factor, factor]))
            .collect()
    }
    fn terms(&self, session: &RotorSession, shape: &[f64]) -> Vec<Readings> {
        vec![session.explained_beyond(&changed(session.rotor(), shape))]
    }
    fn place(&self, session: &RotorSession, shape: &[f64]) -> Option<String> {
        let bearing = &session.rotor().bearings[shape[0] as usize];
        Some(format!("node {}", bearing.node))
    }
    fn mend(&self, shape: &[f64], _: &[f64], place: &mut RotorPlace) -> bool {
        let rotor = place.machine.rotor.as_mut();
        let Some(rotor) = rotor.filter(|r| r.ross_model.is_none()) else {
            return false;
        };
        *rotor = changed(rotor, shape);
        rotor.bearings[shape[0] as usize].table.is_empty()
    }
    fn experiment(&self) -> &'static str {
        RUN_UP
    }
}

/// `rotor` with the stiffness of a bearing along x and y multiplied, what couples them by the
/// mean of both.
fn changed(rotor: &Rotor, shape: &[f64]) -> Rotor {
    let mut rotor = rotor.clone();
    let factors = [shape[1], shape[2]];
    let own = &mut rotor.bearings[shape[0] as usize];
    let table = own.table.iter_mut().map(|at| &mut at.stiffness_n_per_m);
    for stiffness in own.stiffness_n_per_m.iter_mut().chain(table) {
        for (row, a) in stiffness.iter_mut().zip(factors) {
            for (k, b) in row.iter_mut().zip(factors) {
                *k *= (a * b).sqrt();
            }
        }
    }
    rotor
}
