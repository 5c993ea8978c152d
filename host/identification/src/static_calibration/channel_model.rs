//! Transfer of a static characteristic into the channel of a description, and what its estimator
//! has no setting for.

use super::Absence;
use super::candidate_term::Term;
use super::characteristic::{Characteristic, Data};
use loadtwin_machine::{Channel, Creep, Hysteresis};

/// Offset, gain and terms as the estimator has them; readings in SI, loads in parts of nominal.
#[derive(Clone, Debug, Default)]
pub struct ChannelModel {
    /// Reading without load.
    pub offset: f64,
    /// Slope at zero load [1/(N m)].
    pub gain: f64,
    /// `n` of `s (1 + n s / nominal)`; none where these loads do not show it.
    pub nonlinearity: Option<f64>,
    /// Half the width of the loop, and its level; the inner none where there is none.
    pub hysteresis: Option<Option<[f64; 2]>>,
    /// Creep at nominal load, and its time constant (s); the inner none where there is none.
    pub creep: Option<Option<[f64; 2]>>,
    /// What was found and is not written, or otherwise, one line each.
    pub notes: Vec<String>,
}

impl ChannelModel {
    /// `largest` load and `nominal` one of the channel [N m].
    pub(super) fn new(
        data: &Data<'_>,
        found: &Characteristic,
        absent: &[(&'static str, Absence)],
        [largest, nominal]: [f64; 2],
    ) -> Self {
        let [least_level, _] = Hysteresis::LEVELS;
        let is_shown = |kind: &str| {
            let not_shown = |(name, why): &(&str, Absence)| {
                *name == kind && matches!(why, Absence::NotShown(_))
            };
            !absent.iter().any(not_shown)
        };
        let mut model = Self {
            nonlinearity: is_shown("nonlinearity").then_some(0.0),
            hysteresis: is_shown("hysteresis").then_some(None),
            creep: is_shown("creep").then_some(None),
            notes: notes(found),
            ..Self::default()
        };
        let mut fitted = Characteristic::of(data, estimator_terms(found), found.level);
        if let Some(k) = place(&fitted, Term::Quadratic) {
            let [_, gain] = fitted.mean_line(data);
            let n = fitted.coefficient(data, k) * nominal / (gain * largest);
            if n.abs() <= Channel::MOST_NONLINEARITY && fitted.p_values[k] < fitted.level {
                model.nonlinearity = Some(n);
            } else {
                fitted.terms.remove(k);
                fitted = Characteristic::of(data, fitted.terms, found.level);
                model
                    .notes
                    .push("nonlinearity: 0 is written, and the gain of the nearest line".into());
            }
        }
        let [offset, gain] = fitted.mean_line(data);
        (model.offset, model.gain) = (offset, gain / largest);
        for (k, term) in fitted.terms.iter().enumerate() {
            let coefficient = fitted.coefficient(data, k);
            match term {
                Term::Hysteresis { level, .. } if level * largest < least_level * nominal => {
                    model.hysteresis = None;
                    model.notes.push(format!(
                        "hysteresis: not written, it turns over less than {least_level} of the nominal load"
                    ));
                }
                Term::Hysteresis { level, .. } => {
                    model.hysteresis = Some(Some([coefficient, level * largest / nominal]));
                }
                Term::Creep { time_s } => {
                    model.creep = Some(Some([coefficient * nominal / largest, *time_s]));
                }
                _ => {}
            }
        }
        model
    }

    /// `channel` with what was found; settings that these loads do not show stay.
    #[must_use]
    pub fn applied(&self, channel: &Channel) -> Channel {
        let own = |si: f64| channel.unit.from_si(si);
        let mut changed = Channel {
            offset: own(self.offset),
            sensitivity: Some(own(self.gain)),
            ..channel.clone()
        };
        if let Some(nonlinearity) = self.nonlinearity {
            changed.nonlinearity = nonlinearity;
        }
        if let Some(found) = self.hysteresis {
            changed.hysteresis = found.map(|[half_width, level]| Hysteresis {
                half_width: own(half_width),
                level,
            });
        }
        if let Some(found) = self.creep {
            changed.creep = found.map(|[at_nominal, time_s]| Creep {
                at_nominal: own(at_nominal),
                time_s,
            });
        }
        changed
    }
}

fn place(of: &Characteristic, term: Term) -> Option<usize> {
    of.terms.iter().position(|own| *own == term)
}

/// What the estimator has another term for, or none.
fn notes(found: &Characteristic) -> Vec<String> {
    let cubic = match (place(found, Term::Cubic), place(found, Term::Quadratic)) {
        (Some(_), None) => Some("cubic: the estimator gets the nearest quadratic"),
        (Some(_), Some(_)) => Some("cubic: not written, the estimator has no such term"),
        _ => None,
    };
    let speed = place(found, Term::Speed)
        .map(|_| "speed: not written, the estimator has no such term; offset and gain are those at standstill");
    cubic.into_iter().chain(speed).map(str::to_owned).collect()
}

/// The terms as the estimator has them: a loop that is not centred, a quadratic for a cubic. Speed
/// stays in the fit, so that offset and gain hold at standstill.
fn estimator_terms(found: &Characteristic) -> Vec<Term> {
    let has_quadratic = place(found, Term::Quadratic).is_some();
    let own = |term: &Term| match *term {
        Term::Hysteresis { level, start, .. } => Some(Term::Hysteresis {
            level,
            start,
            is_centred: false,
        }),
        Term::Cubic => (!has_quadratic).then_some(Term::Quadratic),
        other => Some(other),
    };
    found.terms.iter().filter_map(own).collect()
}
