//! Candidate effect, gravity torque of an arm or an unbalanced mass: cosine and sine of the angle.

use crate::candidate_effect::{Effect, Motion, Scale, ShapeParameter, each};
use loadtwin_machine::Regime;

/// `a cos(x) + b sin(x)`, `x` the angle [rad]: over less than a turn a polynomial
/// fits it as well, but not beyond what was fitted.
pub(crate) struct Gravity;

impl Effect for Gravity {
    fn name(&self) -> &'static str {
        "gravity"
    }

    fn shapes(&self, scale: &Scale) -> Vec<Vec<f64>> {
        if scale.is_angle && scale.regime != Regime::Steady && scale.window().is_some() {
            vec![vec![]]
        } else {
            Vec::new()
        }
    }

    fn shape_parameters(&self) -> &'static [ShapeParameter] {
        &[]
    }

    fn columns(&self, motion: &Motion, _: &[f64]) -> Vec<Vec<f64>> {
        vec![
            each(&motion.position, f64::cos),
            each(&motion.position, f64::sin),
        ]
    }

    fn shown_by(&self) -> &'static str {
        "slow motion both ways over half a turn or more"
    }

    fn terms(&self, _: &[f64], _: usize) -> Vec<String> {
        vec!["cosine of the angle".into(), "sine of the angle".into()]
    }
}
