//! Candidate effect: friction that falls with speed as `exp(-(|v|/v_s)^d)`, d 1 or 2 (Stribeck),
//! and either builds up over a distance after a reversal or fades at rest.

use crate::candidate_effect::{
    Effect, Motion, Scale, ShapeParameter, ShapeUnit, each, friction_state, geometric, times,
};

/// `F_s exp(-(|v| / v_s)^d) sgn(v)`.
///
/// Shape: `[v_s, d, s, v_r]`: speed [rad/s, m/s], exponent, distance to build up,
/// and the speed below which it fades to nothing at rest, or 0.
///
/// Source: Armstrong-Helouvry, Dupont, Canudas de Wit 1994, eq. (2).
pub(crate) struct Stribeck;

impl Effect for Stribeck {
    fn name(&self) -> &'static str {
        "stribeck-friction"
    }

    fn shapes(&self, scale: &Scale) -> Vec<Vec<f64>> {
        let mut shapes = Vec::new();
        let kept = scale.sliding().into_iter().map(|s| [s, 0.0]);
        let fading = scale.creeping(&[0.005, 0.03]).into_iter();
        for [s, v_r] in kept.chain(fading.map(|v_r| [0.0, v_r])) {
            for speed in geometric(0.01 * scale.speed, 0.6 * scale.speed, 9) {
                for exponent in [1.0, 2.0] {
                    shapes.push(vec![speed, exponent, s, v_r]);
                }
            }
        }
        shapes
    }

    fn shape_parameters(&self) -> &'static [ShapeParameter] {
        const {
            &[
                ShapeParameter::new("speed over which it falls", ShapeUnit::Speed),
                ShapeParameter::new("exponent", ShapeUnit::Number),
                ShapeParameter::new("distance to build up", ShapeUnit::Travel),
                ShapeParameter::new("speed below which it fades", ShapeUnit::Speed),
            ]
        }
    }

    fn refined(&self) -> &'static [usize] {
        &[0, 3]
    }

    fn columns(&self, motion: &Motion, shape: &[f64]) -> Vec<Vec<f64>> {
        let fading = each(&motion.speed, |v| {
            (-(v.abs() / shape[0]).powf(shape[1])).exp()
        });
        vec![times(&fading, &friction_state(motion, shape[2], shape[3]))]
    }

    fn shown_by(&self) -> &'static str {
        "constant speeds from the slowest that the machine keeps"
    }

    fn terms(&self, _: &[f64], _: usize) -> Vec<String> {
        vec!["friction at rest above that at speed".into()]
    }
}
