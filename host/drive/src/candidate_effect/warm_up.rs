//! Candidate effect: friction and drag that change exponentially with the time since the start of a
//! recording, where no temperature is recorded.

use crate::candidate_effect::{
    Effect, Motion, Scale, ShapeParameter, ShapeUnit, each, sliding_state, times,
};
use loadtwin_machine::Regime;

/// `w (c_0 sgn(v) + c_1 v)`, `w = 1 - exp(-t / T)` from the start of a recording.
///
/// Shape: `[T, s]`, the time to warm up [s].
pub(crate) struct WarmUp;

impl Effect for WarmUp {
    fn name(&self) -> &'static str {
        "warm-up"
    }

    fn shapes(&self, scale: &Scale) -> Vec<Vec<f64>> {
        if scale.regime != Regime::Moving || scale.temperature.is_some() {
            return Vec::new();
        }
        let mut shapes = Vec::new();
        for s in scale.sliding() {
            for part in [0.1, 0.3, 1.0] {
                shapes.push(vec![part * scale.duration_s, s]);
            }
        }
        shapes
    }

    fn shape_parameters(&self) -> &'static [ShapeParameter] {
        const {
            &[
                ShapeParameter::new("time to warm up", ShapeUnit::Time),
                ShapeParameter::new("distance to build up", ShapeUnit::Travel),
            ]
        }
    }

    fn columns(&self, motion: &Motion, shape: &[f64]) -> Vec<Vec<f64>> {
        let start = motion.t.first().copied().unwrap_or(0.0);
        let warm = each(&motion.t, |t| 1.0 - (-(t - start) / shape[0]).exp());
        vec![
            times(&warm, &sliding_state(motion, shape[1])),
            times(&warm, &motion.speed),
        ]
    }

    fn shown_by(&self) -> &'static str {
        "the same motion repeated from cold, with the temperature recorded"
    }

    fn terms(&self, _: &[f64], _: usize) -> Vec<String> {
        vec!["friction when warm".into(), "drag when warm".into()]
    }
}
