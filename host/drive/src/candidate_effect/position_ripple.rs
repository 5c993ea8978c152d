//! Candidate effect: ripple of torque or force over the position, with a pitch found by search.

use std::f64::consts::TAU;

use crate::candidate_effect::{Effect, Motion, Scale, ShapeParameter, ShapeUnit, each, geometric};
use loadtwin_machine::Regime;

/// `a cos(2 pi x / p) + b sin(2 pi x / p)`: gear teeth, balls, screw threads.
///
/// Shape: `[p]`, the pitch [rad, m].
pub(crate) struct PositionRipple;

impl Effect for PositionRipple {
    fn name(&self) -> &'static str {
        "position-ripple"
    }

    fn shapes(&self, scale: &Scale) -> Vec<Vec<f64>> {
        let travel = scale.span.1 - scale.span.0;
        if scale.regime == Regime::Steady || travel.is_nan() || travel <= 0.0 {
            return Vec::new();
        }
        // Shorter than what the band resolves at speed, it could not be seen.
        let shortest = (2.0 * scale.speed * scale.resolution_s).max(travel / 200.0);
        let longest = 0.7 * travel;
        if shortest >= longest {
            return Vec::new();
        }
        // Steps in which the phase at the far end turns by half a turn.
        let count = (2.0 * (travel / shortest - travel / longest))
            .ceil()
            .clamp(2.0, 300.0);
        geometric(travel / longest, travel / shortest, count as usize)
            .into_iter()
            .map(|waves| vec![travel / waves])
            .collect()
    }

    fn shape_parameters(&self) -> &'static [ShapeParameter] {
        const { &[ShapeParameter::new("pitch", ShapeUnit::Travel)] }
    }

    fn refined(&self) -> &'static [usize] {
        &[0]
    }

    fn columns(&self, motion: &Motion, shape: &[f64]) -> Vec<Vec<f64>> {
        let wave = TAU / shape[0];
        vec![
            each(&motion.position, |x| (wave * x).cos()),
            each(&motion.position, |x| (wave * x).sin()),
        ]
    }

    fn shown_by(&self) -> &'static str {
        "slow motion over the whole travel at two speeds"
    }

    fn terms(&self, _: &[f64], _: usize) -> Vec<String> {
        vec!["cosine".into(), "sine".into()]
    }

    fn repeats(&self) -> usize {
        3
    }
}
