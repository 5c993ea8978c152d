//! The command `loadtwin diagnose`: finds the physical effects that the model of a drivetrain,
//! rotor or bearing lacks in recordings with reference loads, compares the estimator before and
//! after, and writes the improved description where it is not worse. Drives with a `[balance]` go
//! to `diagnose_drive.rs`.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;
use serde_json::json;

use super::diagnose_drive;
use super::file_plan::{Plan, Replace};
use super::layout_option::LayoutFile;
use super::printing::{note, say};
use super::progress::Progress;
use crate::balance::{self as drive, Request};
use crate::diagnose::candidate_effect::Effect;
use crate::diagnose::{
    self, BearingResiduals, Diagnosable, Diagnosis, DrivetrainResiduals, Evaluated, FilterCheck,
    Innovations, RELEVANT_PART, ResidualTests, RotorResiduals, Verdict,
};
use crate::machine::{Kind, Machine};
use crate::origin::with_origin;
use crate::replay::{Comparison, ReplayError};
use crate::report::PAGE;

/// Find which physical effect a model lacks, and add it.
///
/// Looks for the effect in recordings with reference loads, or in the torque
/// balance of a measured drive, and reports the error before and after.
#[derive(Debug, Args)]
#[command(after_long_help = library())]
pub struct Diagnose {
    /// Machine description (TOML).
    machine: PathBuf,
    /// Recordings (CSV, Parquet or MDF4).
    #[arg(required = true)]
    recordings: Vec<PathBuf>,
    /// Recordings that take no part in the fit and on which the error is reported.
    /// Without them it is reported on the fitted recordings (of a measured drive on
    /// their last third, which is then left out).
    #[arg(long, num_args = 1.., value_name = "RECORDING")]
    validate: Vec<PathBuf>,
    /// Write the machine description with what was found.
    #[arg(short, long, alias = "out", value_name = "FILE.toml")]
    output: Option<PathBuf>,
    /// Write a page with plots to FILE.html.
    #[arg(long, value_name = "FILE.html")]
    report: Option<PathBuf>,
    /// Evaluate the balance of a measured drive below this frequency [Hz]; the
    /// description's `tuning.cutoff_hz` where absent.
    #[arg(long, value_name = "HZ")]
    cutoff_hz: Option<f64>,
    /// Change of a load below which an effect is negligible [% of nominal]: it is listed, but
    /// neither named nor written. 0 names every significant effect of a size.
    #[arg(long, value_name = "PERCENT", default_value_t = 100.0 * RELEVANT_PART)]
    relevant_percent: f64,
    #[command(flatten)]
    replace: Replace,
    #[command(flatten)]
    layout: LayoutFile,
}

impl Diagnose {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        let started = Instant::now();
        anyhow::ensure!(
            (0.0..=100.0).contains(&self.relevant_percent),
            "--relevant-percent {}: allowed: 0 to 100",
            self.relevant_percent
        );
        Plan::new(self.replace)
            .description(&self.machine)
            .reads(self.layout.file())
            .reads_held_out(&self.recordings, &self.validate)
            .writes_description("--output", self.output.as_deref())
            .writes("--report", self.report.as_deref(), PAGE)
            .check(as_json)?;
        let machine = self.layout.machine(&self.machine)?;
        if machine.balance.is_some() {
            return self.run_balance(&machine, as_json);
        }
        match machine.kind() {
            Some(Kind::Rotor(_)) => self.run_kind::<RotorResiduals>(&machine, started, as_json),
            Some(Kind::Bearing(_)) => self.run_kind::<BearingResiduals>(&machine, started, as_json),
            _ => self.run_kind::<DrivetrainResiduals>(&machine, started, as_json),
        }
    }

    fn run_kind<S: Diagnosable>(
        &self,
        machine: &Machine,
        started: Instant,
        as_json: bool,
    ) -> anyhow::Result<()> {
        let progress = Progress::new("diagnose");
        let mut diagnosis: Diagnosis<S> = diagnose::diagnose_above(
            machine,
            &self.recordings,
            &self.validate,
            self.relevant_percent / 100.0,
            |part| progress.show(part),
        )?;
        drop(progress);
        let innovations = diagnose::innovations(machine, &self.recordings);
        let improves = matches!(
            diagnosis.verdict,
            Verdict::Effects(_) | Verdict::Inseparable(_)
        );
        // The report has what was found, the description what the estimator accepts.
        let found = diagnosis.selection.found.clone();
        let nuisance = diagnosis.selection.nuisance.clone();
        let filter = if improves {
            let evaluated = Evaluated::choose(&self.recordings, &self.validate);
            Some(diagnose::check_filter(machine, &mut diagnosis, evaluated)?)
        } else {
            None
        };
        let written = match (&self.output, &filter) {
            (Some(path), Some(check)) if check.is_accepted => {
                write_description(machine, &diagnosis, path)?;
                Some(path.as_path())
            }
            _ => None,
        };
        (diagnosis.selection.found, diagnosis.selection.nuisance) = (found, nuisance);
        if let Some(path) = &self.report {
            let innovations = innovations.as_deref().unwrap_or_default();
            self.write_page(machine, &diagnosis, innovations, filter.as_ref(), path)?;
        }
        if as_json {
            let mut out = diagnose::report(
                machine,
                &diagnosis,
                &innovations,
                filter.as_ref(),
                &self.validate,
                written,
            );
            if let Some(object) = out.as_object_mut() {
                object.insert("seconds".into(), json!(started.elapsed().as_secs_f64()));
            }
            say!("{out}");
        } else {
            self.print_all(&diagnosis, filter.as_ref(), &innovations, started);
        }
        Ok(())
    }

    fn write_page<S: Diagnosable>(
        &self,
        machine: &Machine,
        diagnosis: &Diagnosis<S>,
        innovations: &[Innovations],
        filter: Option<&FilterCheck>,
        path: &Path,
    ) -> anyhow::Result<()> {
        let names: Vec<String> = self
            .recordings
            .iter()
            .map(|r| r.display().to_string())
            .collect();
        let page = diagnose::page(machine, &names.join(", "), diagnosis, innovations, filter);
        with_origin(page, Some(&machine.path)).write(path)?;
        Ok(())
    }

    fn print_all<S: Diagnosable>(
        &self,
        diagnosis: &Diagnosis<S>,
        filter: Option<&FilterCheck>,
        innovations: &Result<Vec<Innovations>, ReplayError>,
        started: Instant,
    ) {
        print(diagnosis);
        if let Some(check) = filter {
            print_filter(check);
        }
        print_innovations(innovations);
        if self.validate.is_empty() {
            say!("errors on the fitted recordings: give others with --validate");
        }
        say!("{:.1} s", started.elapsed().as_secs_f64());
    }

    fn run_balance(&self, machine: &Machine, as_json: bool) -> anyhow::Result<()> {
        let cutoff_hz = self.cutoff_hz.unwrap_or(machine.tuning.cutoff_hz);
        anyhow::ensure!(
            cutoff_hz > 0.0 && cutoff_hz.is_finite(),
            "--cutoff-hz {cutoff_hz}: allowed: above 0"
        );
        let request = Request {
            machine,
            fit: &self.recordings,
            validate: &self.validate,
            cutoff_hz,
            machine_out: self.output.as_deref(),
        };
        diagnose_drive::run(&request, self.report.as_deref(), as_json)
    }
}

/// Writes the improved description; a note on the effects that it has no place for.
fn write_description<S: Diagnosable>(
    machine: &Machine,
    diagnosis: &Diagnosis<S>,
    path: &Path,
) -> anyhow::Result<()> {
    let absent = S::write(machine, diagnosis, path)?;
    if !absent.is_empty() {
        note(format_args!(
            "loadtwin: not in {}: {}: the line has no place for it yet\n",
            path.display(),
            absent.join(", ")
        ));
    }
    Ok(())
}

fn print<S: Diagnosable>(diagnosis: &Diagnosis<S>) {
    print_verdict(diagnosis);
    print_candidates(diagnosis);
    print_residual_tests(&diagnosis.residual_tests);
    print_errors(diagnosis);
}

/// The verdict: effects found with their places, corrections, and what the data do not show.
fn print_verdict<S: Diagnosable>(diagnosis: &Diagnosis<S>) {
    say!("{}", diagnose::headline(&diagnosis.verdict));
    let recording = &diagnosis.recordings[0];
    for found in &diagnosis.selection.found {
        let place = |shape: &Vec<f64>| found.effect.location(recording, shape);
        let places: Vec<String> = [&found.shape]
            .into_iter()
            .chain(&found.equivalent_locations)
            .filter_map(place)
            .collect();
        if !places.is_empty() {
            say!("{} at {}", found.effect.name(), places.join(", or at "));
        }
        if !found.indistinguishable_from.is_empty()
            && matches!(diagnosis.verdict, Verdict::Effects(_))
        {
            say!(
                "{}: this recording does not tell it from {}",
                found.effect.name(),
                found.indistinguishable_from.join(", ")
            );
        }
    }
    let negligible = diagnosis.selection.negligible_names();
    if !negligible.is_empty() {
        say!(
            "significant, but negligible for the load: {}",
            negligible.join(", ")
        );
    }
    for correction in &diagnosis.corrections {
        say!(
            "an empirical correction over {} takes {:.0} % of {} (see --json)",
            correction.over.to_lowercase(),
            100.0 * correction.explained,
            correction.channel
        );
    }
    if let Some(remainder) = diagnosis.remainder() {
        say!("{remainder}");
    }
    let mut named = diagnosis.named().iter();
    if let Some(open) = named.find(|f| f.is_ambiguous()) {
        say!("what would: {}", open.effect.recommended_experiment());
    }
    let silent = diagnose::cannot_show(&diagnosis.selection);
    if !silent.is_empty() {
        say!(
            "of these the recording shows nothing: {}",
            silent.join(", ")
        );
    }
    if let Some(note) = recording.remarks(&diagnosis.selection) {
        say!("{note}");
    }
}

/// Ranking of the candidates, and the residuals before and after.
fn print_candidates<S: Diagnosable>(diagnosis: &Diagnosis<S>) {
    say!("{:<26}{:>12}{:>12}", "candidate", "evidence", "by chance");
    for ranked in diagnosis.selection.ranking.iter().take(8) {
        say!(
            "{:<26}{:>12.1}{:>12}",
            ranked.effect.name(),
            ranked.score.log_evidence,
            (ranked.threshold).map_or_else(|| "-".into(), |t| format!("{t:.1}"))
        );
    }
    say!(
        "{:<20}{:>10}{:>10}{:>8}{:>8}",
        "residual",
        "before",
        "after",
        "Hz",
        "top 10%"
    );
    for excess in &diagnosis.residual_excesses {
        say!(
            "{:<20}{:>10.2}{:>10.2}{:>8.1}{:>8.2}",
            excess.channel,
            excess.before,
            excess.after,
            excess.frequency_hz,
            excess.concentration
        );
    }
}

/// Errors of load or residual, without and with the effects.
fn print_errors<S: Diagnosable>(diagnosis: &Diagnosis<S>) {
    let cell = |value: Option<f64>| value.map_or_else(|| "-".into(), |v| format!("{v:.3} %"));
    let errors = &diagnosis.errors;
    for (name, pair) in [
        ("as described", errors.nominal),
        ("recalibrated", errors.recalibrated),
    ] {
        say!(
            "error {name}: {} before, {} after",
            cell(pair.before.value_percent),
            cell(pair.after.value_percent)
        );
    }
}

/// What each residual goes with most clearly.
fn print_residual_tests(residual_tests: &[ResidualTests]) {
    /// Tests of each residual that are printed.
    const CLEAREST: usize = 2;
    say!(
        "{:<20}{:<40}{:>8}{:>8}{:>11}",
        "residual",
        "goes with",
        "before",
        "after",
        "by chance"
    );
    for tests in residual_tests {
        for tested in tests.significant().into_iter().take(CLEAREST) {
            say!(
                "{:<20}{:<40}{:>8.2}{:>8.2}{:>11}",
                tests.channel,
                tested.to_string(),
                tested.before,
                tested.after,
                (tested.by_chance).map_or_else(|| "-".into(), |c| format!("{c:.2}"))
            );
        }
    }
}

/// The estimator before and after, and what is not written.
fn print_filter(check: &FilterCheck) {
    say!("estimator before and after, on {}:", check.data());
    let say_sets = |sets: &[Comparison]| {
        for set in sets {
            let worse = if set.is_worse() { ": worse" } else { "" };
            say!("  {}{worse}", set.line());
        }
    };
    say_sets(&check.sets);
    if !check.left_out.is_empty() {
        say!("without {}:", check.left_out.join(", "));
        say_sets(&check.sets_without);
    }
    if let Some(refused) = &check.refused {
        say!("no description is written: it would have {refused}");
    } else if !check.is_accepted {
        let worse: Vec<&str> = check.worse().map(|set| set.sensors.as_str()).collect();
        say!(
            "no description is written: the estimator is worse with it ({})",
            worse.join(", ")
        );
    } else if !check.left_out.is_empty() {
        say!(
            "not in the description, for the estimator is worse with it: {}",
            check.left_out.join(", ")
        );
    }
}

fn print_innovations(innovations: &Result<Vec<Innovations>, ReplayError>) {
    match innovations {
        Ok(innovations) => {
            for of in innovations {
                if let (Some(nis), Some([low, high])) = (of.nis, of.nis_bounds) {
                    say!(
                        "innovations of {} in {}: NIS {nis:.2} ({low:.2} to {high:.2} in a consistent filter)",
                        of.sensors,
                        of.recording.display()
                    );
                }
            }
        }
        Err(reason) => say!("no innovations: {reason}"),
    }
}

/// The effects, for the long help.
fn library() -> String {
    let shown = |effect: &&dyn drive::candidate_effect::Effect| {
        format!("  {:<28}{}\n", effect.name(), effect.shown_by())
    };
    let of_balance: String = drive::EFFECTS.iter().map(shown).collect();
    format!(
        "Effects:\n{}\nEffects of a rotor:\n{}\nEffects of a bearing:\n{}\n\
         Effects in a torque balance, and what shows them:\n{}",
        listed::<DrivetrainResiduals>(),
        listed::<RotorResiduals>(),
        listed::<BearingResiduals>(),
        of_balance
    )
}

fn listed<S: Diagnosable>() -> String {
    let line =
        |effect: &&dyn Effect<S>| format!("  {:<26}{}\n", effect.name(), effect.description());
    S::library().iter().map(line).collect()
}
