//! Runs `diagnose` on one recording of the benchmark, and measures the load error of the
//! improved description.

use std::error::Error;
use std::time::Instant;

use loadtwin::diagnose::{
    Diagnosable, Diagnosis, DrivetrainResiduals, ResidualModel, Verdict, by_name,
};
use loadtwin::machine::Machine;

use crate::cases::{Case, Kind};
use crate::score::Row;

/// Simulates the case, in a profile that shows it, diagnoses it without its label, then with the true
/// effects as the only candidates.
pub fn evaluate(number: usize, drawn: &Case, machine: &Machine) -> Result<Row, Box<dyn Error>> {
    let (case, shows) = if drawn.kind == Kind::Outside {
        (drawn.clone(), true)
    } else {
        drawn.shown(machine)?
    };
    let folder = tempfile::tempdir()?;
    let (fitted, held_out) = (
        folder.path().join("fitted.parquet"),
        folder.path().join("held_out.parquet"),
    );
    case.record(machine, &fitted, &held_out)?;
    let (fitted, held_out) = (vec![fitted], vec![held_out]);
    let started = Instant::now();
    let mut residuals = DrivetrainResiduals::read(machine, &fitted, &held_out, |_| ())?;
    // What is detected; how much matters is the user's choice.
    residuals.relevant_part = 0.0;
    let diagnosis = residuals.diagnose(DrivetrainResiduals::library(), |_| ());
    let seconds = started.elapsed().as_secs_f64();
    let said = match &diagnosis.verdict {
        Verdict::Effects(names) | Verdict::Inseparable(names) => names.join(" "),
        Verdict::None | Verdict::Unknown => String::new(),
    };
    let open = (diagnosis.selection.found.iter())
        .filter(|_| matches!(diagnosis.verdict, Verdict::Effects(_)))
        .flat_map(|f| {
            f.indistinguishable_from
                .iter()
                .map(|other| format!("{}={other}", f.effect.name()))
        })
        .collect::<Vec<_>>()
        .join(" ");
    let true_effects: Option<Vec<_>> = case
        .effects
        .iter()
        .map(|(name, _)| by_name::<DrivetrainResiduals>(name))
        .collect();
    let given = match true_effects {
        Some(effects) if !effects.is_empty() => after(&residuals.diagnose(&effects, |_| ())),
        _ => None,
    };
    Ok(Row {
        number,
        machine: case.machine,
        kind: case.kind,
        profile: case.profile.to_owned(),
        drawn: drawn.profile.to_owned(),
        truth: case.truth(),
        shows,
        verdict: diagnosis.verdict.as_str().to_owned(),
        said,
        open,
        before: diagnosis.errors.nominal.before.value_percent,
        after: after(&diagnosis),
        given,
        seconds,
    })
}

/// Error on the hold-out recording with the effects reported; an unknown effect corrects
/// nothing.
fn after(diagnosis: &Diagnosis<DrivetrainResiduals>) -> Option<f64> {
    let errors = diagnosis.errors.nominal;
    let error = match diagnosis.verdict {
        Verdict::Effects(_) | Verdict::Inseparable(_) => errors.after,
        Verdict::None | Verdict::Unknown => errors.before,
    };
    error.value_percent
}
