//! Candidate effect: cogging, torque that repeats with every turn, as harmonics of the position.

use std::f64::consts::TAU;

use crate::candidate_effect::{Effect, Motion, Scale, ShapeParameter, ShapeUnit, each};
use loadtwin_machine::Regime;

/// `sum_n a_n cos(n theta) + b_n sin(n theta)`, `theta = 2 pi x / turn`, `n = 1..orders`.
///
/// Shape: `[orders, turn]`.
///
/// Source: Piccoli, Yim 2014, Cogging torque ripple minimization via position
/// based characterization.
pub(crate) struct TorqueRipple;

/// Highest orders that are tried, harmonics of one turn.
const ORDERS: [f64; 7] = [2.0, 4.0, 8.0, 16.0, 32.0, 64.0, 128.0];

impl Effect for TorqueRipple {
    fn name(&self) -> &'static str {
        "torque-ripple"
    }

    fn shapes(&self, scale: &Scale) -> Vec<Vec<f64>> {
        let travel = scale.span.1 - scale.span.0;
        match scale.turn {
            // Less than most of a turn does not tell orders apart.
            Some(turn) if scale.regime != Regime::Steady && travel > 0.8 * turn => ORDERS
                .into_iter()
                .filter(|orders| 3.0 * orders < scale.rows as f64)
                .map(|orders| vec![orders, turn])
                .collect(),
            _ => Vec::new(),
        }
    }

    fn shape_parameters(&self) -> &'static [ShapeParameter] {
        const {
            &[
                ShapeParameter::new("orders", ShapeUnit::Number),
                ShapeParameter::new("travel of one turn", ShapeUnit::Travel),
            ]
        }
    }

    fn columns(&self, motion: &Motion, shape: &[f64]) -> Vec<Vec<f64>> {
        let mut columns = Vec::new();
        for n in 1..=shape[0] as i32 {
            let wave = f64::from(n) * TAU / shape[1];
            columns.push(each(&motion.position, |x| (wave * x).cos()));
            columns.push(each(&motion.position, |x| (wave * x).sin()));
        }
        columns
    }

    fn shown_by(&self) -> &'static str {
        "several slow turns both ways"
    }

    fn terms(&self, shape: &[f64], _: usize) -> Vec<String> {
        (1..=shape[0] as i32)
            .flat_map(|n| [format!("order {n} cosine"), format!("order {n} sine")])
            .collect()
    }
}
