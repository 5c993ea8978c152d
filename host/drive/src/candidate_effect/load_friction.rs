//! Candidate effect: friction in proportion to the size of each measured load, or of the
//! acceleration where no load is measured.

use crate::candidate_effect::{
    Effect, Motion, Scale, ShapeParameter, ShapeUnit, each, geometric, sliding_state, times,
};
use loadtwin_machine::Regime;

/// `mu |L| z`, with `z` the state of sliding over a distance `s`.
///
/// `L` is each measured load; where none is, the acceleration, to which the
/// transmitted force of inertia is proportional. Shape: `[s]`.
pub(crate) struct LoadFriction;

impl Effect for LoadFriction {
    fn name(&self) -> &'static str {
        "load-dependent-friction"
    }

    fn shapes(&self, scale: &Scale) -> Vec<Vec<f64>> {
        if scale.loads == 0 && (!scale.accelerates || scale.regime == Regime::Steady) {
            return Vec::new();
        }
        let distances = scale.distances(&geometric(1e-4, 0.1, 5));
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
        let z = sliding_state(motion, shape[0]);
        if motion.loads.is_empty() {
            return vec![times(&each(&motion.acceleration, f64::abs), &z)];
        }
        let size = |load: &Vec<f64>| times(&each(load, f64::abs), &z);
        motion.loads.iter().map(size).collect()
    }

    fn shown_by(&self) -> &'static str {
        "the same motion at several loads"
    }

    fn terms(&self, _: &[f64], loads: usize) -> Vec<String> {
        match loads {
            0 => vec!["friction per acceleration".into()],
            n => (1..=n).map(|i| format!("friction per load {i}")).collect(),
        }
    }
}
