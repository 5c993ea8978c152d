//! Candidate effect: a torque or force that changes smoothly over the travel, by a polynomial of
//! degree 1 to 3.

use crate::candidate_effect::{Effect, Motion, Scale, ShapeParameter, ShapeUnit, each};
use loadtwin_machine::Regime;

/// `sum_n c_n u^n`, `u = (x - x_0) / h`, `n = 1..degree`: springs, cables that
/// wind, imbalance.
///
/// Shape: `[degree, x_0, h]`.
pub(crate) struct PositionTorque;

impl Effect for PositionTorque {
    fn name(&self) -> &'static str {
        "position-dependent-torque"
    }

    fn shapes(&self, scale: &Scale) -> Vec<Vec<f64>> {
        match scale.window() {
            Some([centre, half]) if scale.regime != Regime::Steady => [1.0, 2.0, 3.0]
                .map(|degree| vec![degree, centre, half])
                .to_vec(),
            _ => Vec::new(),
        }
    }

    fn shape_parameters(&self) -> &'static [ShapeParameter] {
        const {
            &[
                ShapeParameter::new("degree", ShapeUnit::Number),
                ShapeParameter::new("centre", ShapeUnit::Travel),
                ShapeParameter::new("half width", ShapeUnit::Travel),
            ]
        }
    }

    fn columns(&self, motion: &Motion, shape: &[f64]) -> Vec<Vec<f64>> {
        (1..=shape[0] as i32)
            .map(|n| each(&motion.position, |x| ((x - shape[1]) / shape[2]).powi(n)))
            .collect()
    }

    fn shown_by(&self) -> &'static str {
        "slow motion both ways over the whole travel"
    }

    fn terms(&self, shape: &[f64], _: usize) -> Vec<String> {
        (1..=shape[0] as i32).map(|n| format!("u^{n}")).collect()
    }
}
