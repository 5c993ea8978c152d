//! Dry friction.

use super::{Effect, Motion, Scale, sliding_state};

/// `F_c sgn(v)`, with a short distance `s` of sliding to build up.
///
/// Shape: `[s]`.
pub(super) struct Coulomb;

impl Effect for Coulomb {
    fn name(&self) -> &'static str {
        "coulomb-friction"
    }

    fn shapes(&self, scale: &Scale) -> Vec<Vec<f64>> {
        scale
            .distances(&[0.0, 1e-4])
            .into_iter()
            .map(|s| vec![s])
            .collect()
    }

    fn shape_length(&self) -> usize {
        1
    }

    fn columns(&self, motion: &Motion, shape: &[f64]) -> Vec<Vec<f64>> {
        vec![sliding_state(motion, shape[0])]
    }

    fn shown_by(&self) -> &'static str {
        "reversals at several constant speeds"
    }

    fn terms(&self, _: &[f64], _: usize) -> Vec<String> {
        vec!["friction".into()]
    }
}
