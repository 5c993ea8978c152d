//! Candidate effect: Coulomb friction, a constant torque or force against the motion. Column: the
//! sign of the motion, which builds up over a short distance or fades at rest.

use crate::candidate_effect::{Effect, Motion, Scale, ShapeParameter, ShapeUnit, friction_state};

/// `F_c sgn(v)`, with a short distance `s` of sliding to build up; or, below a
/// speed `v_r > 0`, fading to nothing at rest.
///
/// Shape: `[s, v_r]`.
pub(crate) struct Coulomb;

impl Effect for Coulomb {
    fn name(&self) -> &'static str {
        "coulomb-friction"
    }

    fn shapes(&self, scale: &Scale) -> Vec<Vec<f64>> {
        let kept = scale.distances(&[0.0, 1e-4]).into_iter();
        let fading = scale.creeping(&[0.003, 0.01, 0.03, 0.1]).into_iter();
        kept.map(|s| vec![s, 0.0])
            .chain(fading.map(|v_r| vec![0.0, v_r]))
            .collect()
    }

    fn shape_parameters(&self) -> &'static [ShapeParameter] {
        const {
            &[
                ShapeParameter::new("distance to build up", ShapeUnit::Travel),
                ShapeParameter::new("speed below which it fades", ShapeUnit::Speed),
            ]
        }
    }

    fn refined(&self) -> &'static [usize] {
        &[1]
    }

    fn columns(&self, motion: &Motion, shape: &[f64]) -> Vec<Vec<f64>> {
        vec![friction_state(motion, shape[0], shape[1])]
    }

    fn shown_by(&self) -> &'static str {
        "reversals at several constant speeds"
    }

    fn terms(&self, _: &[f64], _: usize) -> Vec<String> {
        vec!["friction".into()]
    }
}
