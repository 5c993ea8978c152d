//! What is said, and its JSON.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::Diagnosis;
use super::columns::base_columns;
use super::effect::{Coupling, Effect};
use super::fit::Data;
use super::innovations::Innovations;
use super::null::Draws;
use super::observed::Observed;
use super::oddity::Oddity;
use super::select::{Found, Selection};
use super::spread::spreads;
use super::statistics::{mean_and_spread, mean_square};
use super::structure::{Structure, Test, Tested};
use loadtwin_machine::Machine;
use loadtwin_replay::ReplayError;

/// Part of the excess that what was found must explain, or something else is missing.
const EXPLAINED: f64 = 0.7;

/// Excess of the mean square that counts as something, over how much it
/// differs from draw to draw.
const EXCESS: f64 = 8.0;

/// How well the simulations know the mean square of what a clean machine
/// leaves, where vibrations are most of it.
pub(super) const ROUGHLY: f64 = 0.03;

/// Part of a clean machine's mean square that counts as a form.
const FORM: f64 = 0.3;

/// Evidence of faulty samples that counts.
const FAULTS: f64 = 40.0;

/// What is said.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// Nothing is missing.
    None,
    /// These effects, by name, the first found first.
    Effects(Vec<&'static str>),
    /// One of these, and which experiment would tell.
    Inseparable(Vec<&'static str>),
    /// Something that no candidate explains.
    Unknown,
}

impl Verdict {
    /// Judges what the search found and what it left.
    pub fn of<S: Observed>(
        sessions: &[S],
        selection: &Selection<S>,
        oddities: &[Oddity],
        structures: &[Structure],
        draws: &Draws,
    ) -> Self {
        let faults: Vec<&'static str> = S::library()
            .iter()
            .filter(|e| evidence_of_faults(**e, sessions) > FAULTS)
            .map(|e| e.name())
            .collect();
        let nameless = selection.ranking.is_empty();
        if unexplained(sessions, selection, oddities, draws)
            || nameless && has_form(oddities, structures)
        {
            return Self::Unknown;
        }
        let mut names: Vec<&'static str> =
            selection.found.iter().map(|f| f.effect.name()).collect();
        if let ([only], true) = (selection.found.as_slice(), faults.is_empty())
            && only.is_open()
        {
            names.extend(&only.alike);
            return Self::Inseparable(names);
        }
        names.extend(faults);
        if names.is_empty() {
            Self::None
        } else {
            Self::Effects(names)
        }
    }

    /// The word in JSON.
    pub fn word(&self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Effects(names) if names.len() == 1 => "effect",
            Self::Effects(_) => "effects",
            Self::Inseparable(_) => "inseparable",
            Self::Unknown => "unknown",
        }
    }
}

/// Whether more is left than chance leaves, and more than what a form that is
/// not quite right leaves of an effect.
fn unexplained<S: Observed>(
    sessions: &[S],
    selection: &Selection<S>,
    oddities: &[Oddity],
    draws: &Draws,
) -> bool {
    let data = Data::new(sessions, draws);
    let left = data.left_of_draws(&data.base(base_columns(sessions, &selection.found)));
    let samples: f64 = sessions.iter().map(|s| s.speed().len() as f64).sum();
    let weight = |k: usize| {
        let n = samples / sessions[0].inflation(k);
        // What a mean square differs by from draw to draw, beside what is fitted of it as well, and, as
        // draws share blocks, from block to block of a draw; at least that of white noise.
        let (mut of_draws, mut of_blocks) = (Vec::new(), Vec::new());
        for draw in draws {
            let blocks: Vec<f64> = (sessions.iter().zip(draw))
                .flat_map(|(session, d)| d[k].chunks(session.block()))
                .filter_map(mean_square)
                .collect();
            let (mean, spread) = mean_and_spread(&blocks);
            of_draws.push(mean);
            of_blocks.push(spread / (blocks.len().max(1) as f64).sqrt());
        }
        let (mean, _) = mean_and_spread(&of_draws);
        let (_, spread) = mean_and_spread(&left[k]);
        (spread.max(mean_and_spread(&of_blocks).0) / mean.max(1e-300))
            .max((2.0 / n).sqrt())
            .max(ROUGHLY)
    };
    let (mut before, mut after, mut largest) = (0.0, 0.0, 0.0_f64);
    for (k, oddity) in oddities.iter().enumerate() {
        before += (oddity.before - 1.0).max(0.0);
        after += (oddity.after - 1.0).max(0.0);
        largest = largest.max((oddity.after - 1.0) / weight(k));
    }
    largest > EXCESS && after > (1.0 - EXPLAINED) * before
}

/// Whether some residual goes with an order or a quantity, by more than how well a clean machine
/// is known. Where nothing can be named that is all there is to say.
fn has_form(oddities: &[Oddity], structures: &[Structure]) -> bool {
    let form = |t: &Tested| t.stands_out() && matches!(t.test, Test::Order | Test::Over);
    (oddities.iter().zip(structures))
        .flat_map(|(o, s)| s.tests.iter().map(move |t| (o, t)))
        .any(|(o, t)| form(t) && o.before * t.before > FORM)
}

/// Logarithm of the odds that faulty samples give for an effect.
fn evidence_of_faults<S: Observed>(effect: &dyn Effect<S>, sessions: &[S]) -> f64 {
    sessions
        .iter()
        .flat_map(Observed::streams)
        .map(|s| effect.evidence_of_faults(s))
        .sum()
}

/// The object that `--json` prints.
pub fn report<S: Observed>(
    machine: &Machine,
    diagnosis: &Diagnosis<S>,
    innovations: &Result<Vec<Innovations>, ReplayError>,
    validated_on: &[PathBuf],
    machine_out: Option<&Path>,
) -> Value {
    let Diagnosis {
        sessions,
        selection,
        verdict,
        ..
    } = diagnosis;
    let unknown = *verdict == Verdict::Unknown;
    let mut effects: Vec<Value> = if unknown {
        Vec::new()
    } else {
        (selection.found.iter())
            .map(|f| found(f, sessions, &selection.rest))
            .collect()
    };
    for effect in S::library() {
        let evidence = evidence_of_faults(*effect, sessions);
        if evidence > FAULTS {
            let channels: Vec<&str> = (sessions[0].streams().iter().enumerate())
                .filter(|(_, s)| effect.evidence_of_faults(s) > 0.0)
                .map(|(k, _)| sessions[0].name(k))
                .collect();
            effects.push(json!({
                "name": effect.name(), "about": effect.about(), "channels": channels,
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
                "name": r.effect.name(), "about": r.effect.about(),
                "evidence": r.trial.score, "threshold": r.threshold,
                "channels": acting(&r.trial.streams, sessions),
            })
        })
        .collect();
    let next_experiment = (selection.found.iter())
        .find(|f| f.is_open() && !unknown)
        .map(|f| f.effect.experiment());
    let mut out = json!({
        "machine": machine.name,
        "verdict": verdict.word(),
        "cannot_show": cannot_show(selection),
        "effects": effects,
        "alternatives": alternatives,
        "next_experiment": next_experiment,
        "note": sessions[0].note(selection),
        "error": diagnosis.errors,
        "validated_on": validated_on,
        "machine_out": machine_out,
        "structure": diagnosis.structures,
        "innovations": innovations.as_ref().map_or_else(|e| json!({ "refused": e.to_string() }), |i| json!(i)),
        "empirical_corrections": diagnosis.corrections,
        "unexplained": if unknown { json!(strangest(&diagnosis.oddities)) } else { Value::Null },
    });
    if let Some(object) = out.as_object_mut() {
        object.extend(sessions[0].particulars());
    }
    out
}

/// The effect of that name.
pub fn by_name<S: Observed>(name: &str) -> Option<&'static dyn Effect<S>> {
    S::library().iter().copied().find(|e| e.name() == name)
}

/// The effects of which the recordings show nothing, whether they are there or not.
pub fn cannot_show<S: Observed>(selection: &Selection<S>) -> Vec<&'static str> {
    S::library()
        .iter()
        .filter(|e| !e.linear().is_empty())
        .map(|e| e.name())
        .filter(|name| !selection.ranking.iter().any(|r| r.effect.name() == *name))
        .collect()
}

/// The streams with the most left, the worst first.
pub fn strangest(oddities: &[Oddity]) -> Vec<&Oddity> {
    let mut worst: Vec<&Oddity> = oddities.iter().filter(|o| o.after > 1.1).collect();
    worst.sort_by(|a, b| b.after.total_cmp(&a.after));
    worst.truncate(4);
    worst
}

fn acting<S: Observed>(gains: &[f64], sessions: &[S]) -> Vec<String> {
    let most = gains.iter().copied().fold(0.0, f64::max);
    (gains.iter().enumerate())
        .filter(|(_, g)| **g > 4.0 && **g > 0.01 * most)
        .map(|(k, _)| sessions[0].name(k).to_owned())
        .collect()
}

fn found<S: Observed>(f: &Found<S>, sessions: &[S], rest: &[Vec<Vec<f64>>]) -> Value {
    let name = |k: &usize| sessions[0].name(*k).to_owned();
    let place = |shape: &[f64]| f.effect.place(&sessions[0], shape);
    let mut parameters = serde_json::Map::new();
    for (shape, value) in f.effect.shape().iter().zip(&f.shape) {
        parameters.insert(format!("{} [{}]", shape.name, shape.unit), json!(value));
    }
    let acting: Vec<usize> = (0..sessions[0].streams().len())
        .filter(|k| !f.parameters[*k].is_empty())
        .collect();
    let spreads = spreads(sessions, f, rest);
    let mut stds = serde_json::Map::new();
    for (j, linear) in f.effect.linear().iter().enumerate() {
        let told = |of: &[Vec<f64>]| {
            let value = |k: &usize| json!(of[*k].get(j));
            match f.effect.coupling() {
                Coupling::Shared => acting.first().map_or(Value::Null, value),
                Coupling::Own => (acting.iter())
                    .map(|k| (name(k), value(k)))
                    .collect::<serde_json::Map<_, _>>()
                    .into(),
            }
        };
        parameters.insert(linear.name.into(), told(&f.parameters));
        stds.insert(linear.name.into(), told(&spreads));
    }
    json!({
        "name": f.effect.name(),
        "about": f.effect.about(),
        "channels": acting.iter().map(name).collect::<Vec<_>>(),
        "place": place(&f.shape),
        "or_is": f.alike,
        "or_at": f.elsewhere.iter().map(|shape| place(shape)).collect::<Vec<_>>(),
        "parameters": parameters,
        "std": stds,
        "evidence": f.evidence,
        "threshold": f.threshold,
    })
}
