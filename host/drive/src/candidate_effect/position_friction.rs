//! Candidate effect: friction that changes over the travel, by a polynomial of degree 1 or 2.

use crate::candidate_effect::{
    Effect, Motion, Scale, ShapeParameter, ShapeUnit, each, geometric, sliding_state, times,
};
use loadtwin_machine::Regime;

/// `sum_n c_n u^n z`, `u = (x - x_0) / h`, `n = 1..degree`, `z` the state of
/// sliding over a distance `s`: tight spots, cables that press at an end.
///
/// Shape: `[s, degree, x_0, h]`.
pub(crate) struct PositionFriction;

impl Effect for PositionFriction {
    fn name(&self) -> &'static str {
        "position-dependent-friction"
    }

    fn shapes(&self, scale: &Scale) -> Vec<Vec<f64>> {
        let Some([centre, half]) = scale.window().filter(|_| scale.regime != Regime::Steady) else {
            return Vec::new();
        };
        let mut shapes = Vec::new();
        for s in scale.distances(&geometric(1e-4, 0.1, 5)) {
            for degree in [1.0, 2.0] {
                shapes.push(vec![s, degree, centre, half]);
            }
        }
        shapes
    }

    fn shape_parameters(&self) -> &'static [ShapeParameter] {
        const {
            &[
                ShapeParameter::new("distance to build up", ShapeUnit::Travel),
                ShapeParameter::new("degree", ShapeUnit::Number),
                ShapeParameter::new("centre", ShapeUnit::Travel),
                ShapeParameter::new("half width", ShapeUnit::Travel),
            ]
        }
    }

    fn refined(&self) -> &'static [usize] {
        &[0]
    }

    fn columns(&self, motion: &Motion, shape: &[f64]) -> Vec<Vec<f64>> {
        let z = sliding_state(motion, shape[0]);
        (1..=shape[1] as i32)
            .map(|n| {
                times(
                    &z,
                    &each(&motion.position, |x| ((x - shape[2]) / shape[3]).powi(n)),
                )
            })
            .collect()
    }

    fn shown_by(&self) -> &'static str {
        "slow motion both ways over the whole travel"
    }

    fn terms(&self, shape: &[f64], _: usize) -> Vec<String> {
        (1..=shape[1] as i32)
            .map(|n| format!("u^{n} friction"))
            .collect()
    }
}
