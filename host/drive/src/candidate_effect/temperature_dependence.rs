//! Candidate effect: offset, friction and drag that change in proportion to the recorded
//! temperature.

use crate::candidate_effect::{
    Effect, Motion, Scale, ShapeParameter, ShapeUnit, each, sliding_state, times,
};

/// `(T - T_0) (c_0 + c_1 sgn(v) + c_2 v)`.
///
/// Shape: `[T_0, s]`.
pub(crate) struct TemperatureDependence;

impl Effect for TemperatureDependence {
    fn name(&self) -> &'static str {
        "temperature-dependence"
    }

    fn shapes(&self, scale: &Scale) -> Vec<Vec<f64>> {
        let Some(temperature) = scale.temperature else {
            return Vec::new();
        };
        scale
            .sliding()
            .into_iter()
            .map(|s| vec![temperature, s])
            .collect()
    }

    fn shape_parameters(&self) -> &'static [ShapeParameter] {
        const {
            &[
                ShapeParameter::new("reference temperature", ShapeUnit::Temperature),
                ShapeParameter::new("distance to build up", ShapeUnit::Travel),
            ]
        }
    }

    fn columns(&self, motion: &Motion, shape: &[f64]) -> Vec<Vec<f64>> {
        let rest = vec![shape[0]; motion.len()];
        let warm = each(motion.temperature.as_ref().unwrap_or(&rest), |t| {
            t - shape[0]
        });
        let friction = times(&warm, &sliding_state(motion, shape[1]));
        let drag = times(&warm, &motion.speed);
        vec![warm, friction, drag]
    }

    fn shown_by(&self) -> &'static str {
        "the same motion cold and warm"
    }

    fn terms(&self, _: &[f64], _: usize) -> Vec<String> {
        ["zero", "friction", "drag"]
            .map(|what| format!("{what} per kelvin"))
            .into()
    }
}
