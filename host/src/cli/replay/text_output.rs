//! Prints the text output of `loadtwin replay`: table of errors by sensor set, load and segment;
//! displacement errors, flags, 1x phasor inversion and baseline algorithms.

use loadtwin_common::io::fault::Fault;

use super::Outcome;
use crate::cli::printing::say;
use crate::machine::{Kind, Machine};
use crate::replay::{Displacements, Figures, Phasor};
use crate::report::Table;

/// One line for each set and load: NMAE in full and by segment, RMSE.
pub(in crate::cli) fn print_table(machine: &Machine, outcomes: &[Outcome]) {
    let cell =
        |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"));
    let mut header = format!("{:<24}{:<14}{:>8}", "NMAE [% of nominal]", "load", "full");
    for segment in &machine.segments {
        header += &format!("{:>11}", segment.name);
    }
    say!(
        "{header}{:>8}{:>8}{:>8}{:>8}{:>8}{:>8}",
        "RMSE",
        "NIS",
        "next",
        "1 σ %",
        "2 σ %",
        "3 σ %"
    );
    for outcome in outcomes {
        for (name, load) in outcome.figures.loads() {
            if load.rmse.is_none()
                && outcome
                    .figures
                    .loads()
                    .any(|(_, other)| other.rmse.is_some())
            {
                continue;
            }
            let mut line = format!("{:<24}{name:<14}", outcome.set);
            line += &format!(
                " {:>7}",
                cell(load.nmae_percent.get("full").copied().flatten())
            );
            for segment in &machine.segments {
                line += &format!(
                    " {:>10}",
                    cell(load.nmae_percent.get(&segment.name).copied().flatten())
                );
            }
            let inside = |k: usize| {
                let percent = load.band.map(|band| band.inside_percent[k]);
                percent.map_or_else(|| "-".to_owned(), |percent| format!("{percent:.1}"))
            };
            say!(
                "{line} {:>7} {:>7} {:>7} {:>7} {:>7} {:>7}",
                cell(load.rmse_percent),
                cell(outcome.figures.nis_mean()),
                cell(outcome.figures.largest_next()),
                inside(0),
                inside(1),
                inside(2)
            );
        }
    }
}

pub(super) fn print_displacements(displacements: &Displacements) {
    for (segment, worst) in displacements.worst_m() {
        say!(
            "displacement, any node, {segment}: error up to {:.3} µm",
            1e6 * worst
        );
    }
}

/// Of a drive, how large the unknown load is: where none acts that is the error.
pub(super) fn print_sizes(machine: &Machine, figures: &Figures) {
    let Some(Kind::Drive(_)) = machine.kind() else {
        return;
    };
    for ((name, load), described) in figures.loads().zip(machine.loads()) {
        if let (None, Some(rms), Some(mean)) = (load.rmse, load.rms, load.mean) {
            let (unit, nominal) = (described.unit, described.nominal);
            let part = |value: f64| 100.0 * value / nominal;
            say!(
                "{name}: estimate, RMS {rms:.4} {unit} ({:.1} % of nominal), mean {mean:.4} {unit} ({:.1} %)",
                part(rms),
                part(mean)
            );
        }
    }
}

/// What the 1x phasor inversion comes to, by segment.
pub(super) fn print_phasor(machine: &Machine, phasor: &Phasor) {
    let segments = machine.segments.iter().map(|s| s.name.as_str());
    let names: Vec<&str> = std::iter::once("full").chain(segments).collect();
    for (load, figures) in phasor.figures() {
        let by_segment: Vec<String> = (names.iter())
            .filter_map(|name| Some((name, (*figures.nmae_percent.get(*name)?)?)))
            .map(|(name, percent)| format!("{name} {percent:.2} %"))
            .collect();
        let said = match by_segment.as_slice() {
            [] => "none, for no turn of the shaft has a reference and all sensors".to_owned(),
            all => all.join(", "),
        };
        say!("1x phasor inversion, NMAE {load}: {said}");
    }
}

/// The tables of the paper, each column as wide as its heading.
pub(super) fn print_baselines(table: &Table) {
    say!("{}", table.caption);
    for row in std::iter::once(&table.head).chain(&table.rows) {
        let cells: Vec<String> = (row.iter().zip(&table.head))
            .map(|(cell, head)| format!("{cell:>0$}", head.chars().count().max(11)))
            .collect();
        say!("{}", cells.join("  "));
    }
}

pub(super) fn print_flags(figures: &Figures) {
    for (fault, count) in figures.flags() {
        let cause = Fault::ALL.into_iter().find(|f| f.name() == *fault);
        say!(
            "flagged {fault}: {count} ({})",
            cause.map_or("", Fault::cause)
        );
    }
}
