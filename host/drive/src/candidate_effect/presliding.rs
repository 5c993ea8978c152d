//! Candidate effect: friction that builds up over a distance after a reversal (Dahl model; several
//! distances make a Maxwell-slip model).

use crate::candidate_effect::{
    Effect, Motion, Scale, ShapeParameter, ShapeUnit, geometric, sliding_state,
};
use loadtwin_machine::Regime;

/// `F z`, `dz = (sgn(dx) - z) |dx| / s`: hysteresis over the position.
///
/// Shape: `[s]`, the distance [rad, m]. Found again with other distances it is a
/// Maxwell-slip model.
///
/// Source: Dahl 1968; Al-Bender, Lampaert, Swevers 2005 (Maxwell slip).
pub(crate) struct Presliding;

impl Effect for Presliding {
    fn name(&self) -> &'static str {
        "presliding-hysteresis"
    }

    fn shapes(&self, scale: &Scale) -> Vec<Vec<f64>> {
        if scale.regime == Regime::Steady {
            return Vec::new();
        }
        let distances = scale.distances(&geometric(3e-4, 0.5, 12));
        distances.into_iter().map(|s| vec![s]).collect()
    }

    fn shape_parameters(&self) -> &'static [ShapeParameter] {
        const {
            &[ShapeParameter::new(
                "distance to build up",
                ShapeUnit::Travel,
            )]
        }
    }

    fn refined(&self) -> &'static [usize] {
        &[0]
    }

    fn columns(&self, motion: &Motion, shape: &[f64]) -> Vec<Vec<f64>> {
        vec![sliding_state(motion, shape[0])]
    }

    fn shown_by(&self) -> &'static str {
        "small reversals of several lengths within the travel"
    }

    fn terms(&self, _: &[f64], _: usize) -> Vec<String> {
        vec!["friction after sliding".into()]
    }

    fn repeats(&self) -> usize {
        3
    }
}
