//! Removes effects that the estimator contradicts: with them no set of sensors estimates better,
//! and some worse. The least significant one is moved to the negligible effects, one by one.

use std::path::PathBuf;

use crate::candidate_effect::fitted::FittedEffect;
use crate::diagnosable::Diagnosable;
use crate::diagnosis::{DiagnoseError, Diagnosis, DiagnosisInput};
use crate::filter_check::{Courses, Evaluated, courses, described};
use loadtwin_machine::Machine;
use loadtwin_replay::{Comparison, Tendency};

/// Moves to the negligible effects of `diagnosis`, one by one, the least significant effect that the estimator
/// contradicts on the fitted recordings `paths`.
///
/// An effect is contradicted where with it some set of sensors becomes worse and none better, each beyond its
/// interval, and no load changes by more than what is relevant: it then describes an error of the
/// model on which the residuals rest. What the estimator cannot model, a value that no description
/// allows and what happened once are kept: the estimator says nothing about them.
///
/// # Errors
/// When a description cannot be written, or the estimator cannot run.
pub(crate) fn set_contradicted_aside<S: Diagnosable>(
    machine: &Machine,
    paths: &[PathBuf],
    input: &DiagnosisInput<S>,
    mut diagnosis: Diagnosis<S>,
) -> Result<Diagnosis<S>, DiagnoseError> {
    if diagnosis.named().is_empty() {
        return Ok(diagnosis);
    }
    let evaluated = Evaluated::whole(paths);
    let already = diagnosis.selection.negligible.len();
    loop {
        let mut kept = diagnosis.selection.found.clone();
        let least = least_contradicted(machine, &evaluated, &mut diagnosis, input.relevant_part)?;
        if let Some(i) = least {
            diagnosis.selection.negligible.push(kept.remove(i));
        }
        let is_done = least.is_none() || kept.is_empty();
        diagnosis.selection.keep(&input.recordings, kept);
        if is_done {
            break;
        }
    }
    if diagnosis.selection.negligible.len() == already {
        return Ok(diagnosis);
    }
    // What is set aside stays in the model: only the names change.
    Ok(input.assess(diagnosis.selection))
}

/// Number of the least significant effect found that the estimator contradicts.
fn least_contradicted<S: Diagnosable>(
    machine: &Machine,
    evaluated: &Evaluated,
    diagnosis: &mut Diagnosis<S>,
    relevant_part: f64,
) -> Result<Option<usize>, DiagnoseError> {
    let found = diagnosis.selection.found.clone();
    let Some((with_all, absent)) = estimated(machine, evaluated, diagnosis, &found)? else {
        return Ok(None);
    };
    let mut least: Option<usize> = None;
    for (i, effect) in found.iter().enumerate() {
        if absent.contains(&effect.effect.name()) || !effect.effect.is_machine_property() {
            continue;
        }
        let mut others = found.clone();
        others.remove(i);
        let Some((without, _)) = estimated(machine, evaluated, diagnosis, &others)? else {
            continue;
        };
        let sets: Vec<Comparison> = (without.iter().zip(&with_all))
            .map(|((name, before), (_, after))| Comparison::new(name, before, after))
            .collect();
        let is = |tendency: Tendency| sets.iter().any(|set| set.tends(tendency));
        let changes = |set: &Comparison| set.largest_change_percent() > 100.0 * relevant_part;
        if is(Tendency::Worse)
            && !is(Tendency::Better)
            && !sets.iter().any(changes)
            && least.is_none_or(|least| effect.evidence < found[least].evidence)
        {
            least = Some(i);
        }
    }
    Ok(least)
}

/// What the estimator of each set of sensors does with the effects `kept`, fitted anew, and the names of those
/// that it cannot model; none where a description may not have their values.
fn estimated<S: Diagnosable>(
    machine: &Machine,
    evaluated: &Evaluated,
    diagnosis: &mut Diagnosis<S>,
    kept: &[FittedEffect<S>],
) -> Result<Option<(Courses, Vec<&'static str>)>, DiagnoseError> {
    let recordings = std::mem::take(&mut diagnosis.recordings);
    diagnosis.selection.keep(&recordings, kept.to_vec());
    diagnosis.recordings = recordings;
    Ok(match described(machine, diagnosis)? {
        Ok(improved) => Some((
            courses(machine, &improved.machine, evaluated)?,
            improved.absent,
        )),
        Err(_) => None,
    })
}
