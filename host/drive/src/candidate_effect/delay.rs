//! Candidate effect: delay of the drive signal against motion and loads, to first order: regression
//! on the derivatives of the acceleration and of each load, with a coefficient for each.

use crate::candidate_effect::{Effect, Motion, Scale, ShapeParameter};
use loadtwin_machine::Regime;

/// `-T J da/dt - T_j dL_j/dt`: a drive recorded late by `T` against the motion,
/// and against each load.
pub(crate) struct Delay;

impl Effect for Delay {
    fn name(&self) -> &'static str {
        "delay"
    }

    fn shapes(&self, scale: &Scale) -> Vec<Vec<f64>> {
        if scale.regime == Regime::Moving {
            vec![vec![]]
        } else {
            Vec::new()
        }
    }

    fn shape_parameters(&self) -> &'static [ShapeParameter] {
        &[]
    }

    fn columns(&self, motion: &Motion, _: &[f64]) -> Vec<Vec<f64>> {
        let rate = |x: &Vec<f64>| slope(&motion.t, x);
        std::iter::once(&motion.acceleration)
            .chain(&motion.loads)
            .map(rate)
            .collect()
    }

    fn shown_by(&self) -> &'static str {
        "steps of acceleration at a higher sample rate"
    }

    fn terms(&self, _: &[f64], loads: usize) -> Vec<String> {
        let load = |i: usize| format!("delay to load {i} [s]");
        std::iter::once("delay to the motion times inertia".into())
            .chain((1..=loads).map(load))
            .collect()
    }
}

/// Central differences.
fn slope(t: &[f64], x: &[f64]) -> Vec<f64> {
    let last = t.len() - 1;
    (0..t.len())
        .map(|i| {
            let (a, b) = (i.saturating_sub(1), (i + 1).min(last));
            (x[b] - x[a]) / (t[b] - t[a])
        })
        .collect()
}
