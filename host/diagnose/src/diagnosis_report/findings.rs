//! Builds the tables of the report page that show each effect found: place, parameters with 95 %
//! interval, error of the estimator before and after, alternatives, and the next recording.

use crate::Verdict;
use crate::assessment::parameter_std::parameter_stds;
use crate::candidate_effect::Scope;
use crate::candidate_effect::fitted::FittedEffect;
use crate::diagnosable::Diagnosable;
use crate::diagnosis::Diagnosis;
use crate::diagnosis_report::nonlinear_parameter_std::shape_stds;
use crate::filter_check::FilterCheck;
use loadtwin_report::{EffectSize, Finding, Table};

/// Units of parameters that number a place, which the page names instead.
const PLACE_NUMBERS: [&str; 4] = [
    "from 0",
    "0 or 1",
    "0 is left, 1 is right",
    "of those with sensors",
];

/// A table of each effect found. Where something is missing that no candidate explains, of those that explain a part
/// of it.
pub(super) fn findings<S: Diagnosable>(
    diagnosis: &Diagnosis<S>,
    filter: Option<&FilterCheck>,
) -> Vec<Table> {
    let is_part = diagnosis.verdict == Verdict::Unknown;
    let found = if is_part {
        diagnosis.selection.found.as_slice()
    } else {
        diagnosis.named()
    };
    let caption = |k: usize| match (is_part, found.len()) {
        (true, _) => "Explains a part of what is missing, with its 95 % interval".to_owned(),
        (false, 1) => "What was found, with its 95 % interval".to_owned(),
        (false, all) => format!("What was found, {} of {all}, with its 95 % interval", k + 1),
    };
    let errors = errors(diagnosis, filter, found.len());
    (found.iter().enumerate())
        .map(|(k, one)| finding(diagnosis, one, errors.clone()).table(caption(k)))
        .collect()
}

fn finding<S: Diagnosable>(
    diagnosis: &Diagnosis<S>,
    found: &FittedEffect<S>,
    errors: Vec<[String; 2]>,
) -> Finding {
    let effect = found.effect;
    let recording = &diagnosis.recordings[0];
    let mut alternatives: Vec<String> = (found.indistinguishable_from.iter())
        .map(ToString::to_string)
        .collect();
    alternatives.extend(
        (found.equivalent_locations.iter())
            .filter_map(|shape| effect.location(recording, shape))
            .map(|place| format!("the same, {place}")),
    );
    // Of what it leaves, nothing is known.
    let is_part = diagnosis.verdict == Verdict::Unknown;
    if is_part {
        alternatives.push("something that no candidate describes".into());
    }
    let (places, sizes) = sizes(diagnosis, found);
    Finding {
        effect: format!("{}: {}", effect.name(), effect.description()),
        place: effect
            .location(recording, &found.shape)
            .unwrap_or_else(|| places.join(", ")),
        sizes,
        errors,
        alternatives,
        next_recording: (is_part || found.is_ambiguous())
            .then(|| effect.recommended_experiment().into()),
    }
}

/// The signals that the effect acts on, and its parameters.
fn sizes<S: Diagnosable>(
    diagnosis: &Diagnosis<S>,
    found: &FittedEffect<S>,
) -> (Vec<String>, Vec<EffectSize>) {
    let effect = found.effect;
    let recordings = &diagnosis.recordings;
    let residuals = &diagnosis.selection.residuals_after;
    let is_named = effect.location(&recordings[0], &found.shape).is_some();
    let shape = effect.nonlinear_parameters().iter().zip(&found.shape);
    let mut sizes: Vec<EffectSize> = shape
        .zip(shape_stds(recordings, found, residuals))
        .filter(|((parameter, _), _)| !(is_named && PLACE_NUMBERS.contains(&parameter.unit)))
        .map(|((parameter, value), std)| EffectSize {
            channel: String::new(),
            parameter: format!("{} [{}]", parameter.name, parameter.unit)
                .replace(" []", "")
                .replace(" [number]", ""),
            value: *value,
            std,
        })
        .collect();
    let stds = parameter_stds(recordings, found, residuals);
    let acting: Vec<usize> = (0..stds.len())
        .filter(|k| !found.parameters[*k].is_empty())
        .collect();
    let name = |k: &usize| recordings[0].name(*k).to_owned();
    let shown = match effect.scope() {
        // One set for all signals.
        Scope::Machine => &acting[..acting.len().min(1)],
        Scope::PerSignal => &acting[..],
    };
    for k in shown {
        let channel = match effect.scope() {
            Scope::Machine => String::new(),
            Scope::PerSignal => name(k),
        };
        let values = found.parameters[*k].iter().zip(&stds[*k]);
        for (parameter, (value, std)) in effect.linear_parameters().iter().zip(values) {
            sizes.push(EffectSize {
                channel: channel.clone(),
                parameter: parameter.name.into(),
                value: *value,
                std: Some(*std),
            });
        }
    }
    (acting.iter().map(name).collect(), sizes)
}

/// The error of each load before and after, of the first set of sensors; without references that of the model.
fn errors<S: Diagnosable>(
    diagnosis: &Diagnosis<S>,
    filter: Option<&FilterCheck>,
    effects: usize,
) -> Vec<[String; 2]> {
    let all = if effects > 1 { " with all effects" } else { "" };
    let set = filter.and_then(|check| check.last_sets().first());
    let loads: Vec<[String; 2]> = (set.into_iter())
        .flat_map(|set| {
            (set.nmae_percent.iter()).map(|(load, change)| {
                [
                    format!("Error of {load}{all}, sensors {}", set.sensors),
                    change.text(2, " %").replacen('(', "(change: ", 1),
                ]
            })
        })
        .collect();
    if !loads.is_empty() {
        return loads;
    }
    let figure = diagnosis.errors.nominal;
    (figure.before.value_percent.zip(figure.after.value_percent))
        .map(|(before, after)| {
            let change = format!("{before:.3} → {after:.3} % of the nominal load");
            [format!("Error{all}"), change]
        })
        .into_iter()
        .collect()
}
