//! Friction that falls with speed.

use super::{Effect, Motion, Scale, each, geometric, sliding_state, times};

/// `F_s exp(-(|v| / v_s)^d) sgn(v)`.
///
/// Shape: `[v_s, d, s]`: speed [rad/s, m/s], exponent, distance to build up.
///
/// Source: Armstrong-Helouvry, Dupont, Canudas de Wit 1994, eq. (2).
pub(super) struct Stribeck;

impl Effect for Stribeck {
    fn name(&self) -> &'static str {
        "stribeck-friction"
    }

    fn shapes(&self, scale: &Scale) -> Vec<Vec<f64>> {
        let mut shapes = Vec::new();
        for s in scale.sliding() {
            for speed in geometric(0.01 * scale.speed, 0.6 * scale.speed, 9) {
                for exponent in [1.0, 2.0] {
                    shapes.push(vec![speed, exponent, s]);
                }
            }
        }
        shapes
    }

    fn shape_length(&self) -> usize {
        3
    }

    fn refined(&self) -> &'static [usize] {
        &[0]
    }

    fn columns(&self, motion: &Motion, shape: &[f64]) -> Vec<Vec<f64>> {
        let fading = each(&motion.speed, |v| {
            (-(v.abs() / shape[0]).powf(shape[1])).exp()
        });
        vec![times(&fading, &sliding_state(motion, shape[2]))]
    }

    fn shown_by(&self) -> &'static str {
        "constant speeds from the slowest that the machine keeps"
    }

    fn terms(&self, _: &[f64], _: usize) -> Vec<String> {
        vec!["friction at rest above that at speed".into()]
    }
}
