//! Runs the estimator with the original and with the improved description for each sensor set, and
//! compares the errors of the loads or, without references, the likelihoods. While a set is worse,
//! the effect that does the most harm is left out.

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use serde::Serialize;

use crate::candidate_effect::fitted::FittedEffect;
use crate::diagnosable::Diagnosable;
use crate::diagnosis::{DiagnoseError, Diagnosis};
use loadtwin_design::image_build::Sensors;
use loadtwin_files::scratch::Scratch;
use loadtwin_machine::{Machine, MachineError};
use loadtwin_replay::{Comparison, Course, ReplayError};

/// Last part of each fitted recording on which the estimator is evaluated where no recording took no
/// part.
const LAST_PART: f64 = 1.0 / 3.0;

/// Data on which the estimator is evaluated.
#[derive(Clone, Debug, Serialize)]
pub struct Evaluated {
    /// The recordings.
    pub recordings: Vec<PathBuf>,
    /// The last part of each, above 0 up to 1.
    pub last_part: f64,
    /// Whether the effects were fitted to these recordings.
    pub is_fitted: bool,
}

impl Evaluated {
    /// All of `validation`, or, where there is none, the last third of each of `fitted`.
    pub fn choose(fitted: &[PathBuf], validation: &[PathBuf]) -> Self {
        let is_fitted = validation.is_empty();
        Self {
            recordings: if is_fitted { fitted } else { validation }.to_vec(),
            last_part: if is_fitted { LAST_PART } else { 1.0 },
            is_fitted,
        }
    }

    /// All of `fitted`.
    pub(crate) fn whole(fitted: &[PathBuf]) -> Self {
        Self {
            recordings: fitted.to_vec(),
            last_part: 1.0,
            is_fitted: true,
        }
    }
}

/// What the estimator of each set of sensors does on all recordings: name and course of each.
pub(crate) type Courses = Vec<(String, Vec<Course>)>;

/// Check of the estimator with an improved description.
#[derive(Clone, Debug, Serialize)]
pub struct FilterCheck {
    /// On which data.
    #[serde(flatten)]
    pub evaluated: Evaluated,
    /// Each set of sensors with all effects found; none where that description is refused.
    pub sets: Vec<Comparison>,
    /// Value of an effect that a description does not allow: field, found and allowed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refused: Option<String>,
    /// Effects without which no set of sensors is worse; empty where none is with them.
    pub left_out: Vec<&'static str>,
    /// Each set of sensors without the effects left out.
    pub sets_without: Vec<Comparison>,
    /// Whether some description makes no set of sensors worse.
    pub is_accepted: bool,
}

impl FilterCheck {
    /// Sets of sensors that are worse with all effects found.
    pub fn worse(&self) -> impl Iterator<Item = &Comparison> {
        self.sets.iter().filter(|set| set.is_worse())
    }

    /// Each set of sensors with the effects that were kept.
    pub(crate) fn last_sets(&self) -> &[Comparison] {
        if self.left_out.is_empty() {
            &self.sets
        } else {
            &self.sets_without
        }
    }

    /// On which data, in words.
    pub fn data(&self) -> String {
        let names: Vec<String> = (self.evaluated.recordings.iter())
            .map(|path| path.display().to_string())
            .collect();
        let names = names.join(", ");
        if self.evaluated.is_fitted {
            format!(
                "last third of {names}, to which the effects were fitted (give others with --validate)"
            )
        } else {
            names
        }
    }
}

/// The estimators with one improved description.
struct Trial {
    sets: Vec<Comparison>,
    refused: Option<String>,
}

impl Trial {
    fn is_accepted(&self) -> bool {
        self.refused.is_none() && !self.sets.iter().any(Comparison::is_worse)
    }

    /// Largest rise of an error over all sets [% of nominal], or, without references, largest fall of the
    /// logarithm of the likelihood.
    fn harm(&self) -> f64 {
        let of = |set: &Comparison| {
            let rises = set.nmae_percent.values().map(|c| c.after - c.before);
            let falls = (set.log_likelihood.iter())
                .filter(|_| set.nmae_percent.is_empty())
                .map(|c| c.before - c.after);
            rises.chain(falls).fold(f64::NEG_INFINITY, f64::max)
        };
        match self.refused {
            Some(_) => f64::INFINITY,
            None => self.sets.iter().map(of).fold(f64::NEG_INFINITY, f64::max),
        }
    }
}

/// Runs the estimator of every set of sensors on `evaluated`, with `machine` and with the effects of
/// `diagnosis`; where these make a set worse, without the effect that does the most harm, and so on.
/// The selection of `diagnosis` becomes that which is accepted.
///
/// # Errors
/// When a description cannot be written, or the estimator cannot run.
pub fn check_filter<S: Diagnosable>(
    machine: &Machine,
    diagnosis: &mut Diagnosis<S>,
    evaluated: Evaluated,
) -> Result<FilterCheck, DiagnoseError> {
    let before = courses(machine, machine, &evaluated)?;
    let whole = compared(machine, diagnosis, &evaluated, &before)?;
    let mut check = FilterCheck {
        evaluated,
        is_accepted: whole.is_accepted(),
        sets: whole.sets,
        refused: whole.refused,
        left_out: Vec::new(),
        sets_without: Vec::new(),
    };
    while !check.is_accepted && diagnosis.selection.found.len() > 1 {
        let all = diagnosis.selection.found.clone();
        let mut trials = Vec::new();
        for i in 0..all.len() {
            let mut kept = all.clone();
            kept.remove(i);
            keep(diagnosis, kept);
            let trial = compared(machine, diagnosis, &check.evaluated, &before)?;
            trials.push((trial.harm(), i, trial));
        }
        let Some((_, i, trial)) = trials.into_iter().min_by(|a, b| a.0.total_cmp(&b.0)) else {
            break;
        };
        let mut kept = all;
        check.left_out.push(kept.remove(i).effect.name());
        keep(diagnosis, kept);
        check.is_accepted = trial.is_accepted();
        check.sets_without = trial.sets;
        check.refused = trial.refused;
    }
    Ok(check)
}

/// Fits the effects `kept` anew, together.
fn keep<S: Diagnosable>(diagnosis: &mut Diagnosis<S>, kept: Vec<FittedEffect<S>>) {
    diagnosis.selection.keep(&diagnosis.recordings, kept);
}

/// Names of the sets of sensors of `machine`; none for all sensors where it has no sets.
fn set_names(machine: &Machine) -> Vec<Option<String>> {
    match machine.sensor_sets.as_slice() {
        [] => vec![None],
        sets => sets.iter().map(|set| Some(set.name.clone())).collect(),
    }
}

/// Every set of sensors on all recordings.
pub(crate) fn courses(
    described: &Machine,
    machine: &Machine,
    evaluated: &Evaluated,
) -> Result<Courses, ReplayError> {
    set_names(described)
        .into_par_iter()
        .map(|name| {
            let sensors = Sensors::choose(machine, name.as_deref())?;
            let courses = (evaluated.recordings.iter())
                .map(|path| Ok(Course::run(machine, &sensors, path)?.last(evaluated.last_part)))
                .collect::<Result<Vec<_>, ReplayError>>()?;
            Ok((sensors.name, courses))
        })
        .collect()
}

/// Every set of sensors as described, `before`, and with the effects of `diagnosis`; refused where an effect
/// has a value that no description may have.
fn compared<S: Diagnosable>(
    machine: &Machine,
    diagnosis: &Diagnosis<S>,
    evaluated: &Evaluated,
    before: &[(String, Vec<Course>)],
) -> Result<Trial, DiagnoseError> {
    let improved = match described(machine, diagnosis)? {
        Ok(improved) => improved,
        Err(refused) => {
            return Ok(Trial {
                sets: Vec::new(),
                refused: Some(refused),
            });
        }
    };
    let after = courses(machine, &improved.machine, evaluated)?;
    let sets = (before.iter().zip(&after))
        .map(|((name, before), (_, after))| Comparison::new(name, before, after))
        .collect();
    Ok(Trial {
        sets,
        refused: None,
    })
}

/// A description with the effects of a diagnosis.
pub(crate) struct Improved {
    /// The machine.
    pub machine: Machine,
    /// Names of the effects that the estimator cannot model.
    pub absent: Vec<&'static str>,
    /// Where its maps lie.
    _folder: Scratch,
}

/// The description with the effects of `diagnosis`, or the value that no description may have: field, found
/// and allowed.
pub(crate) fn described<S: Diagnosable>(
    machine: &Machine,
    diagnosis: &Diagnosis<S>,
) -> Result<Result<Improved, String>, DiagnoseError> {
    let folder = Scratch::new()?;
    let path = folder.path().join("machine.toml");
    let absent = S::write(machine, diagnosis, &path)?;
    Ok(match read(machine, &path) {
        Err(MachineError::Field {
            field,
            found,
            allowed,
            ..
        }) => Err(format!("{field} = {found}, allowed: {allowed}")),
        read => Ok(Improved {
            machine: read?,
            absent,
            _folder: folder,
        }),
    })
}

/// The description in `path`, for recordings as those of `machine`.
fn read(machine: &Machine, path: &Path) -> Result<Machine, MachineError> {
    let mut improved = Machine::load(path)?;
    improved.recording = machine.recording.clone();
    Ok(improved)
}
