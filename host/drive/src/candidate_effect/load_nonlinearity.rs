//! Candidate effect, nonlinearity of a measured load: a part of the drive in proportion to its
//! signed square.

use crate::candidate_effect::{Effect, Motion, Scale, ShapeParameter, each};

/// `b L |L|` for each measured load: saturation or hardening.
pub(crate) struct LoadNonlinearity;

impl Effect for LoadNonlinearity {
    fn name(&self) -> &'static str {
        "load-nonlinearity"
    }

    fn shapes(&self, scale: &Scale) -> Vec<Vec<f64>> {
        if scale.loads == 0 {
            Vec::new()
        } else {
            vec![vec![]]
        }
    }

    fn shape_parameters(&self) -> &'static [ShapeParameter] {
        &[]
    }

    fn columns(&self, motion: &Motion, _: &[f64]) -> Vec<Vec<f64>> {
        motion
            .loads
            .iter()
            .map(|load| each(load, |l| l * l.abs()))
            .collect()
    }

    fn shown_by(&self) -> &'static str {
        "several loads at rest or at the same slow speed"
    }

    fn terms(&self, _: &[f64], loads: usize) -> Vec<String> {
        (1..=loads)
            .map(|i| format!("drive per square of load {i}"))
            .collect()
    }
}
