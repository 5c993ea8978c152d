//! Candidate effect: drag in proportion to a power of the speed other than 1, from 0.33 to 3.

use crate::candidate_effect::{Effect, Motion, Scale, ShapeParameter, ShapeUnit, each};

/// `F (|v| / v_0)^n sgn(v)`: grease thins (`n < 1`), churned oil resists (`n > 1`).
///
/// Shape: `[n, v_0]`.
pub(crate) struct NonlinearDrag;

impl Effect for NonlinearDrag {
    fn name(&self) -> &'static str {
        "nonlinear-drag"
    }

    fn shapes(&self, scale: &Scale) -> Vec<Vec<f64>> {
        if !scale.slides() {
            return Vec::new();
        }
        [0.33, 0.5, 0.67, 1.5, 2.0, 3.0]
            .map(|n| vec![n, scale.speed])
            .to_vec()
    }

    fn shape_parameters(&self) -> &'static [ShapeParameter] {
        const {
            &[
                ShapeParameter::new("exponent", ShapeUnit::Number),
                ShapeParameter::new("speed that it is over", ShapeUnit::Speed),
            ]
        }
    }

    fn columns(&self, motion: &Motion, shape: &[f64]) -> Vec<Vec<f64>> {
        vec![each(&motion.speed, |v| {
            v.signum() * (v.abs() / shape[1]).powf(shape[0])
        })]
    }

    fn shown_by(&self) -> &'static str {
        "constant speeds over the whole range"
    }

    fn terms(&self, _: &[f64], _: usize) -> Vec<String> {
        vec!["drag at v_0".into()]
    }
}
