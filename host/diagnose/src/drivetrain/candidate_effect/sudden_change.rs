//! Candidate effects, sudden change of a strain channel that persists: a step of its offset, or of
//! its gain (debonding), at a moment that is found by search.

use crate::candidate_effect::{Effect, EffectInfo, LinearParameter, NonlinearParameter, Scope};
use crate::drivetrain::candidate_effect::{GaugeModel, each};
use crate::drivetrain::residual_signals::{DrivetrainResiduals, Regressor};

/// Moments that are tried first.
const CHANGE_TIMES: usize = 60;

/// Part of the squares of the torque that there must be before and after a moment for a gain: at
/// rest a reading contains only the references' noise, and its gain is that of noise.
const LOADED: f64 = 0.01;

/// A change of a channel that stays from a moment on.
pub struct SuddenChange {
    info: EffectInfo,
    /// What changes after the moment.
    term: fn(&DrivetrainResiduals, f64) -> Regressor,
    /// Applies its size to the model of a gauge after the moment.
    apply_to: fn(&mut GaugeModel, f64),
}

/// `scale a` after a moment.
pub const STEP: SuddenChange = SuddenChange {
    info: EffectInfo {
        name: "gauge-step",
        description: "the zero of a channel jumps",
        scope: Scope::PerSignal,
        linear: &[LinearParameter {
            name: "part of full scale",
            prior_std: 0.3,
        }],
        nonlinear: &[NonlinearParameter {
            name: "moment",
            unit: "s",
            bounds: (0.0, f64::INFINITY),
            step: 0.5,
            logarithmic: false,
        }],
        recommended_experiment: "zero and shunt calibration of the channel, then the same run again",
    },
    term: |recording, moment| Regressor::Offset(after(recording, moment)),
    apply_to: |gauge, size| gauge.offset += size * gauge.full_scale,
};

/// `reading a` after a moment.
pub const DEBONDING: SuddenChange = SuddenChange {
    info: EffectInfo {
        name: "gauge-debonding",
        description: "a gauge loses part of its response at a moment",
        scope: Scope::PerSignal,
        linear: &[LinearParameter {
            name: "part of the reading",
            prior_std: 0.3,
        }],
        nonlinear: &[NonlinearParameter {
            name: "moment",
            unit: "s",
            bounds: (0.0, f64::INFINITY),
            step: 0.5,
            logarithmic: false,
        }],
        recommended_experiment: "the same torque ramp twice",
    },
    term: |recording, moment| Regressor::Gain(step_under_load(recording, moment)),
    apply_to: |gauge, size| gauge.map.iter_mut().for_each(|m| *m *= 1.0 + size),
};

impl Effect<DrivetrainResiduals> for SuddenChange {
    fn info(&self) -> &EffectInfo {
        &self.info
    }
    fn initial_values(&self, recording: &DrivetrainResiduals) -> Vec<Vec<f64>> {
        change_times(recording)
    }
    /// The moment is that of the recording.
    fn is_machine_property(&self) -> bool {
        false
    }
    fn regressors(&self, recording: &DrivetrainResiduals, shape: &[f64]) -> Vec<Regressor> {
        vec![(self.term)(recording, shape[0])]
    }
    fn apply_to(&self, _: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        (self.apply_to)(gauge, parameters[0]);
        true
    }
}

fn change_times(recording: &DrivetrainResiduals) -> Vec<Vec<f64>> {
    let t = &recording.signals.t;
    let (first, last) = (t[0], t[t.len() - 1]);
    // A step in the first or last part is an offset for most of the recording.
    let part = |i: usize| (i as f64 + 1.0) / (CHANGE_TIMES as f64 + 1.0);
    let values: Vec<f64> = (0..CHANGE_TIMES)
        .map(|i| first + (last - first) * part(i))
        .collect();
    each(&values)
}

/// As [`after`], but 0 all through where one side of the moment is without load.
fn step_under_load(recording: &DrivetrainResiduals, moment: f64) -> Vec<f64> {
    let mut after = after(recording, moment);
    if !is_loaded(&recording.signals.level, &after) {
        after.fill(0.0);
    }
    after
}

/// Whether there is a torque both where `after` is 0 and where it is 1.
fn is_loaded(level: &[f64], after: &[f64]) -> bool {
    let squares = |weight: fn(f64) -> f64| -> f64 {
        let pairs = level.iter().zip(after);
        pairs.map(|(l, a)| weight(*a) * l * l).sum()
    };
    let (before, behind) = (squares(|a| 1.0 - a), squares(|a| a));
    before.min(behind) >= LOADED * (before + behind)
}

/// 0 before the moment, 1 after it.
fn after(recording: &DrivetrainResiduals, moment: f64) -> Vec<f64> {
    let t = &recording.signals.t;
    t.iter()
        .map(|t| f64::from(u8::from(*t >= moment)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gain_wants_load_before_and_after_its_moment() {
        // Half a run under load, then rest, where noise is all there is.
        let level: Vec<f64> = (0..100).map(|i| if i < 50 { 1.0 } else { 0.001 }).collect();
        let from = |moment: usize| -> Vec<f64> {
            let part = |i: usize| f64::from(u8::from(i >= moment));
            (0..100).map(part).collect()
        };
        assert!(is_loaded(&level, &from(25)));
        assert!(!is_loaded(&level, &from(60)));
        assert!(!is_loaded(&level, &from(0)));
    }
}
