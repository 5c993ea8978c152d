//! Builds the JSON object of `diagnose --json`: verdict, effects found, ranking of candidates,
//! excess and tests of residuals, innovations and check of the filter.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::assessment::innovation_consistency::Innovations;
use crate::assessment::parameter_std::parameter_stds;
use crate::assessment::residual_excess::ResidualExcess;
use crate::assessment::verdict::{MIN_FAULT_LOG_ODDS, Verdict, cannot_show, fault_log_odds};
use crate::candidate_effect::Scope;
use crate::candidate_effect::fitted::FittedEffect;
use crate::diagnosable::Diagnosable;
use crate::diagnosis::Diagnosis;
use crate::diagnosis_report::nonlinear_parameter_std::shape_stds;
use crate::filter_check::FilterCheck;
use loadtwin_machine::Machine;
use loadtwin_replay::ReplayError;

/// The object that `--json` prints.
pub fn report<S: Diagnosable>(
    machine: &Machine,
    diagnosis: &Diagnosis<S>,
    innovations: &Result<Vec<Innovations>, ReplayError>,
    filter: Option<&FilterCheck>,
    validated_on: &[PathBuf],
    machine_out: Option<&Path>,
) -> Value {
    let Diagnosis {
        recordings,
        selection,
        verdict,
        ..
    } = diagnosis;
    let unknown = *verdict == Verdict::Unknown;
    let named = diagnosis.named();
    let mut effects: Vec<Value> = (named.iter())
        .map(|f| found(f, recordings, &selection.residuals_after))
        .collect();
    for effect in S::library() {
        let evidence = fault_log_odds(*effect, recordings);
        if evidence > MIN_FAULT_LOG_ODDS {
            let channels: Vec<&str> = (recordings[0].residuals().iter().enumerate())
                .filter(|(_, s)| effect.fault_log_odds(s) > 0.0)
                .map(|(k, _)| recordings[0].name(k))
                .collect();
            effects.push(json!({
                "name": effect.name(), "about": effect.description(), "channels": channels,
                "parameters": {}, "evidence": evidence,
            }));
        }
    }
    let alternatives: Vec<Value> = selection
        .ranking
        .iter()
        .take(6)
        .map(|r| {
            json!({
                "name": r.effect.name(), "about": r.effect.description(),
                "evidence": r.score.log_evidence, "threshold": r.threshold,
                "channels": acting(&r.score.per_signal, recordings),
            })
        })
        .collect();
    let next_experiment = (named.iter())
        .find(|f| f.is_ambiguous())
        .map(|f| f.effect.recommended_experiment());
    let mut out = json!({
        "machine": machine.name,
        "verdict": verdict.as_str(),
        "cannot_show": cannot_show(selection),
        "effects": effects,
        "negligible": selection.negligible_names(),
        "alternatives": alternatives,
        "next_experiment": next_experiment,
        "note": recordings[0].remarks(selection),
        "error": diagnosis.errors,
        "filter": filter,
        "validated_on": validated_on.iter().map(shown).collect::<Vec<_>>(),
        "machine_out": machine_out.map(shown),
        "structure": diagnosis.residual_tests,
        "innovations": innovations.as_ref().map_or_else(|e| json!({ "refused": e.to_string() }), |i| json!(i)),
        "empirical_corrections": diagnosis.corrections,
        "unexplained_part": diagnosis.unexplained_part,
        "unexplained": if unknown || diagnosis.unexplained_part.is_some() { json!(largest_excess(&diagnosis.residual_excesses)) } else { Value::Null },
    });
    if let Some(object) = out.as_object_mut() {
        object.extend(recordings[0].extra_json());
    }
    out
}

/// The signals with the most left, the worst first.
pub fn largest_excess(residual_excesses: &[ResidualExcess]) -> Vec<&ResidualExcess> {
    let mut worst: Vec<&ResidualExcess> =
        residual_excesses.iter().filter(|o| o.after > 1.1).collect();
    worst.sort_by(|a, b| b.after.total_cmp(&a.after));
    worst.truncate(4);
    worst
}

fn acting<S: Diagnosable>(gains: &[f64], recordings: &[S]) -> Vec<String> {
    let most = gains.iter().copied().fold(0.0, f64::max);
    (gains.iter().enumerate())
        .filter(|(_, g)| **g > 4.0 && **g > 0.01 * most)
        .map(|(k, _)| recordings[0].name(k).to_owned())
        .collect()
}

fn found<S: Diagnosable>(
    f: &FittedEffect<S>,
    recordings: &[S],
    residuals_after: &[Vec<Vec<f64>>],
) -> Value {
    let name = |k: &usize| recordings[0].name(*k).to_owned();
    let place = |shape: &[f64]| f.effect.location(&recordings[0], shape);
    let mut parameters = serde_json::Map::new();
    for (shape, value) in f.effect.nonlinear_parameters().iter().zip(&f.shape) {
        parameters.insert(format!("{} [{}]", shape.name, shape.unit), json!(value));
    }
    let mut stds = serde_json::Map::new();
    let of_shape = shape_stds(recordings, f, residuals_after);
    for (shape, std) in f.effect.nonlinear_parameters().iter().zip(of_shape) {
        stds.insert(format!("{} [{}]", shape.name, shape.unit), json!(std));
    }
    let acting: Vec<usize> = (0..recordings[0].residuals().len())
        .filter(|k| !f.parameters[*k].is_empty())
        .collect();
    let parameter_stds = parameter_stds(recordings, f, residuals_after);
    for (j, linear) in f.effect.linear_parameters().iter().enumerate() {
        let per_place = |of: &[Vec<f64>]| {
            let value = |k: &usize| json!(of[*k].get(j));
            match f.effect.scope() {
                Scope::Machine => acting.first().map_or(Value::Null, value),
                Scope::PerSignal => (acting.iter())
                    .map(|k| (name(k), value(k)))
                    .collect::<serde_json::Map<_, _>>()
                    .into(),
            }
        };
        parameters.insert(linear.name.into(), per_place(&f.parameters));
        stds.insert(linear.name.into(), per_place(&parameter_stds));
    }
    json!({
        "name": f.effect.name(),
        "about": f.effect.description(),
        "channels": acting.iter().map(name).collect::<Vec<_>>(),
        "place": place(&f.shape),
        "or_is": f.indistinguishable_from,
        "or_at": f.equivalent_locations.iter().map(|shape| place(shape)).collect::<Vec<_>>(),
        "parameters": parameters,
        "std": stds,
        "evidence": f.evidence,
        "threshold": f.threshold,
    })
}

/// A path in JSON, whose texts are Unicode: what is not is replaced.
fn shown(path: impl AsRef<Path>) -> String {
    path.as_ref().display().to_string()
}
