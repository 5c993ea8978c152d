//! Candidate effect, a constant load that the drive carries in motion only: at rest a brake or a
//! self-locking screw holds it. Column: 1 in motion, falling to 0 at rest over a speed found by
//! search.

use crate::candidate_effect::{Effect, Motion, Scale, ShapeParameter, ShapeUnit, each};

/// `c |v| / sqrt(v^2 + v_r^2)`: a weight that a brake or a self-locking screw
/// holds once the drive is at rest.
///
/// Shape: `[v_r]` [rad/s, m/s].
pub(crate) struct HeldAtRest;

impl Effect for HeldAtRest {
    fn name(&self) -> &'static str {
        "held-at-rest"
    }

    fn shapes(&self, scale: &Scale) -> Vec<Vec<f64>> {
        scale
            .creeping(&[0.003, 0.01, 0.03, 0.1])
            .into_iter()
            .map(|v_r| vec![v_r])
            .collect()
    }

    fn shape_parameters(&self) -> &'static [ShapeParameter] {
        const {
            &[ShapeParameter::new(
                "speed below which it is held",
                ShapeUnit::Speed,
            )]
        }
    }

    fn refined(&self) -> &'static [usize] {
        &[0]
    }

    fn columns(&self, motion: &Motion, shape: &[f64]) -> Vec<Vec<f64>> {
        vec![each(&motion.speed, |v| v.abs() / v.hypot(shape[0]))]
    }

    fn shown_by(&self) -> &'static str {
        "rests between motions in both directions"
    }

    fn terms(&self, _: &[f64], _: usize) -> Vec<String> {
        vec!["load in motion above that at rest".into()]
    }
}
