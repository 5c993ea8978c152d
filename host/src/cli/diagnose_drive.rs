//! The part of `loadtwin diagnose` for drives with a table `[balance]`: runs the diagnosis of the
//! torque balance (crate `loadtwin_drive`), writes the page, and prints verdict, effects, errors
//! and remainder as text or JSON.

use std::path::Path;
use std::time::Instant;

use serde_json::{Value, json};

use super::printing::say;
use super::progress::Progress;
use crate::balance::{self, Diagnosis, Figure, Parameters, Request};
use crate::origin::with_origin;

/// Diagnoses, writes the improved description and the page at `report`, and prints what was found.
pub(super) fn run(
    request: &Request<'_>,
    report: Option<&Path>,
    as_json: bool,
) -> anyhow::Result<()> {
    let started = Instant::now();
    let progress = Progress::new("diagnose");
    let diagnosis = balance::diagnose(request, |part| progress.show(part))?;
    drop(progress);
    if let (Some(path), Some(balance)) = (report, &request.machine.balance) {
        let page = balance::page(request.machine, balance, &diagnosis);
        with_origin(page, Some(&request.machine.path)).write(path)?;
    }
    let seconds = started.elapsed().as_secs_f64();
    if as_json {
        let mut out = serde_json::to_value(&diagnosis)?;
        if let Value::Object(out) = &mut out {
            out.insert("machine".into(), json!(request.machine.name));
            out.insert("seconds".into(), json!(seconds));
        }
        say!("{out}");
    } else {
        print(&diagnosis);
        say!("{seconds:.1} s");
    }
    Ok(())
}

fn print(diagnosis: &Diagnosis) {
    print_effects(diagnosis);
    print_errors(diagnosis);
    print_remainder(diagnosis);
}

/// Verdict, effects found with their alternatives, and the linear part.
fn print_effects(diagnosis: &Diagnosis) {
    say!("verdict: {}", diagnosis.verdict);
    for note in &diagnosis.notes {
        say!("  {note}");
    }
    for effect in &diagnosis.effects {
        say!(
            "  {:<28} error falls by {:.1} %, p = {:.1e}",
            effect.name,
            effect.evidence.gain_percent,
            effect.evidence.p_value
        );
        let largest = effect.parameters.terms.iter().take(6);
        for (term, value) in largest {
            say!("    {term}: {value:.4}");
        }
        print_shape(&effect.parameters);
    }
    for alternative in &diagnosis.alternatives {
        let instead: Vec<_> = alternative.instead.iter().map(|i| i.0).collect();
        say!(
            "  in place of {}: {}",
            alternative.effect,
            instead.join(", ")
        );
    }
    if let Some(next) = &diagnosis.next_experiment {
        say!("  {next}");
    }
    let linear = &diagnosis.recalibrated;
    say!(
        "linear part: offset {:.4}, inertia {:.4}, drag {:.4}, loads {:.4?}",
        linear.offset,
        linear.inertia,
        linear.drag,
        linear.load_gains
    );
}

/// Each number of an effect's shape, with its unit and standard deviation.
fn print_shape(parameters: &Parameters) {
    let stds = parameters.shape_std.iter();
    for ((name, value), std) in (parameters.shape_names.iter().zip(&parameters.shape)).zip(stds) {
        match std {
            Some(std) => say!("    {name}: {value:.4} +- {std:.4}"),
            None => say!("    {name}: {value:.4}"),
        }
    }
}

/// Errors without and with the effects, on the fitted and on the hold-out recordings.
fn print_errors(diagnosis: &Diagnosis) {
    let figure = |f: &Figure| match (f.value_percent, f.interval_percent) {
        (None, _) => "-".into(),
        (Some(value), None) => format!("{value:.1} % (interval: -)"),
        (Some(value), Some([low, high])) => format!("{value:.1} % ({low:.1} to {high:.1})"),
    };
    say!(
        "error below {} Hz, in parts of the drive's RMS, not fitted (of as many other recordings, 95 %):",
        diagnosis.cutoff_hz
    );
    for (name, e) in [
        ("as described", &diagnosis.error.nominal),
        ("recalibrated", &diagnosis.error.recalibrated),
        (
            "recalibrated, each without its mean",
            &diagnosis.error.recalibrated_own_offset,
        ),
    ] {
        say!(
            "  {name}: {}, with effects {}",
            figure(&e.before),
            figure(&e.after)
        );
    }
    for v in &diagnosis.validated_on {
        say!(
            "  {}: {:.1} %, with effects {:.1} %",
            v.recording,
            v.before_percent,
            v.after_percent
        );
    }
    for b in &diagnosis.beyond {
        say!(
            "  extrapolated: {} up to {:.3}, fitted up to {:.3}",
            b.what,
            b.validated,
            b.fitted
        );
    }
}

/// Samples that were left out, and what remains unexplained.
fn print_remainder(diagnosis: &Diagnosis) {
    if diagnosis.spikes > 0 {
        say!("left out: {} values that jump out alone", diagnosis.spikes);
    }
    let rest = &diagnosis.remainder;
    say!(
        "remainder{}: {:.1} %, correlates {:.2} with its neighbours, {:.2} further on, function of {:.2?}",
        if rest.unknown { ", not noise" } else { "" },
        rest.percent,
        rest.neighbours,
        rest.lasting,
        rest.function_of
    );
}
