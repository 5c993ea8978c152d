//! Candidate effect, backlash: friction behind a gap, which reverses only once the gap is crossed.

use crate::candidate_effect::{Effect, Motion, Scale, ShapeParameter, ShapeUnit, geometric};
use loadtwin_machine::Regime;

/// `F r`, where `r` turns from -1 to 1 once the position has come back by the
/// gap `b`, and the other way: what drags behind a play is felt late.
///
/// Shape: `[b]` [rad, m].
pub(crate) struct Backlash;

impl Effect for Backlash {
    fn name(&self) -> &'static str {
        "backlash"
    }

    fn shapes(&self, scale: &Scale) -> Vec<Vec<f64>> {
        if scale.regime == Regime::Steady {
            return Vec::new();
        }
        let gaps = scale.distances(&geometric(1e-3, 0.2, 10));
        gaps.into_iter().map(|b| vec![b]).collect()
    }

    fn shape_parameters(&self) -> &'static [ShapeParameter] {
        const { &[ShapeParameter::new("gap", ShapeUnit::Travel)] }
    }

    fn refined(&self) -> &'static [usize] {
        &[0]
    }

    fn columns(&self, motion: &Motion, shape: &[f64]) -> Vec<Vec<f64>> {
        // The far side, between `x - b / 2` and `x + b / 2`; it moves when touched.
        let half = 0.5 * shape[0];
        let mut far = motion
            .position
            .iter()
            .copied()
            .find(|x| x.is_finite())
            .unwrap_or(0.0);
        let mut r = 0.0;
        let side = |&x: &f64| {
            if x - half > far {
                (far, r) = (x - half, 1.0);
            } else if x + half < far {
                (far, r) = (x + half, -1.0);
            }
            r
        };
        vec![motion.position.iter().map(side).collect()]
    }

    fn shown_by(&self) -> &'static str {
        "reversals without load and with load"
    }

    fn terms(&self, _: &[f64], _: usize) -> Vec<String> {
        vec!["friction behind the gap".into()]
    }
}
