//! Candidate effect: viscous friction (drag) that differs between forward and backward motion.
//! Column: the absolute speed.

use crate::candidate_effect::{Effect, Motion, Scale, ShapeParameter, each};

/// `c |v|`: half the difference of the drags forward and backward.
pub(crate) struct DirectionalFriction;

impl Effect for DirectionalFriction {
    fn name(&self) -> &'static str {
        "directional-friction"
    }

    fn shapes(&self, scale: &Scale) -> Vec<Vec<f64>> {
        if scale.slides() {
            vec![vec![]]
        } else {
            Vec::new()
        }
    }

    fn shape_parameters(&self) -> &'static [ShapeParameter] {
        &[]
    }

    fn columns(&self, motion: &Motion, _: &[f64]) -> Vec<Vec<f64>> {
        vec![each(&motion.speed, f64::abs)]
    }

    fn shown_by(&self) -> &'static str {
        "the same constant speeds forward and backward"
    }

    fn terms(&self, _: &[f64], _: usize) -> Vec<String> {
        vec!["half the difference of drag, per speed".into()]
    }
}
