//! What happens to a gauge at a moment.

use super::{Effect, GaugeModel, Linear, Shape, each};
use crate::stream::{Session, Term};

/// Moments that are tried first.
const MOMENTS: usize = 60;

/// Part of the squares of the torque that there must be before and after a moment for a gain: at
/// rest a reading is what the references' noise makes of it, and its gain that of noise.
const LOADED: f64 = 0.01;

/// A change of a channel that stays from a moment on.
pub struct Sudden {
    name: &'static str,
    about: &'static str,
    experiment: &'static str,
    size: &'static [Linear],
    /// What changes after the moment.
    term: fn(&Session, f64) -> Term,
    /// Takes its size into a gauge, as it is since then.
    mend: fn(&mut GaugeModel, f64),
}

/// `scale a` after a moment.
pub const STEP: Sudden = Sudden {
    name: "gauge-step",
    about: "the zero of a channel jumps",
    experiment: "zero and shunt calibration of the channel, then the same run again",
    size: &[Linear {
        name: "part of full scale",
        prior_std: 0.3,
    }],
    term: |session, moment| Term::Zero(after(session, moment)),
    mend: |gauge, size| gauge.offset += size * gauge.full_scale,
};

/// `reading a` after a moment.
pub const DEBONDING: Sudden = Sudden {
    name: "gauge-debonding",
    about: "a gauge loses part of its response at a moment",
    experiment: "the same torque ramp twice",
    size: &[Linear {
        name: "part of the reading",
        prior_std: 0.3,
    }],
    term: |session, moment| Term::Gain(after_under_load(session, moment)),
    mend: |gauge, size| gauge.map.iter_mut().for_each(|m| *m *= 1.0 + size),
};

impl Effect for Sudden {
    fn name(&self) -> &'static str {
        self.name
    }
    fn about(&self) -> &'static str {
        self.about
    }
    fn linear(&self) -> &'static [Linear] {
        self.size
    }
    fn shape(&self) -> &'static [Shape] {
        &[Shape {
            name: "moment",
            unit: "s",
            bounds: (0.0, f64::INFINITY),
            step: 0.5,
            logarithmic: false,
        }]
    }
    fn grid(&self, session: &Session) -> Vec<Vec<f64>> {
        moments(session)
    }
    /// The moment is that of the recording.
    fn lasts(&self) -> bool {
        false
    }
    fn terms(&self, session: &Session, shape: &[f64]) -> Vec<Term> {
        vec![(self.term)(session, shape[0])]
    }
    fn mend(&self, _: &[f64], parameters: &[f64], gauge: &mut GaugeModel) -> bool {
        (self.mend)(gauge, parameters[0]);
        true
    }
    fn experiment(&self) -> &'static str {
        self.experiment
    }
}

fn moments(session: &Session) -> Vec<Vec<f64>> {
    let t = &session.signals.t;
    let (first, last) = (t[0], t[t.len() - 1]);
    // A step in the first or last part is an offset for most of the recording.
    let part = |i: usize| (i as f64 + 1.0) / (MOMENTS as f64 + 1.0);
    let values: Vec<f64> = (0..MOMENTS)
        .map(|i| first + (last - first) * part(i))
        .collect();
    each(&values)
}

/// As [`after`], but 0 all through where one side of the moment is without load.
fn after_under_load(session: &Session, moment: f64) -> Vec<f64> {
    let mut after = after(session, moment);
    if !is_loaded(&session.signals.level, &after) {
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
fn after(session: &Session, moment: f64) -> Vec<f64> {
    let t = &session.signals.t;
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
