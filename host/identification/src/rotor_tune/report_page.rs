//! Builds the report page of the tuning of a rotor: chosen noise and evaluation of each method side
//! by side.

use crate::rotor_tune::{Choice, Evaluation};
use loadtwin_machine::Machine;
use loadtwin_report::{Report, Table};

/// The report on the noise chosen by each method, and its evaluation on `recording`.
pub fn page(machine: &Machine, choices: &[(Choice, Evaluation)], recording: &str) -> Report {
    Report {
        title: format!("Tuning of {}", machine.name),
        facts: vec![["Evaluated on".into(), recording.into()]],
        tables: vec![noise(machine, choices), evaluation(choices)],
        ..Report::default()
    }
}

fn noise(machine: &Machine, choices: &[(Choice, Evaluation)]) -> Table {
    let loads = machine.rotor.iter().flat_map(|rotor| &rotor.loads);
    let mut head = vec!["Method".to_owned()];
    head.extend(loads.map(|load| format!("Walk {} [N/√s]", load.names.join(", "))));
    head.extend(["Model error", "Initial spread"].map(String::from));
    head.extend((machine.channels.iter()).map(|c| format!("{} [{}]", c.name, c.unit.symbol())));
    head.extend(["Misfit", "f1, eq. (15)", "f2, eq. (15)"].map(String::from));
    let rows = choices.iter().map(|(choice, _)| {
        let Choice {
            method,
            machine,
            outcome,
        } = choice;
        let mut row = vec![method.name().to_owned()];
        let mut number = |value: f64| row.push(format!("{value:.3e}"));
        if let Some(rotor) = &machine.rotor {
            for load in &rotor.loads {
                number(load.walk(rotor.speed_rad_s));
            }
            number(rotor.reduction.model_std);
            number(rotor.reduction.initial_std);
        }
        machine.channels.iter().for_each(|c| number(c.noise_std));
        row.push(format!("{:.4}", outcome.misfit));
        row.extend(outcome.objectives.map(|f| format!("{f:.3e}")));
        row
    });
    Table {
        caption: "Noise of the filter, and what the tuned recordings say of it".into(),
        rows: rows.collect(),
        head,
    }
}

fn evaluation(choices: &[(Choice, Evaluation)]) -> Table {
    let first = choices.first().map(|(_, evaluation)| evaluation);
    let segments: Vec<&String> = first
        .iter()
        .flat_map(|j| j.displacement_um.keys())
        .collect();
    let loads: Vec<&String> = first.iter().flat_map(|j| j.nmae_percent.keys()).collect();
    let cell = |value: Option<f64>| value.map_or("–".into(), |value| format!("{value:.3}"));
    let mut head = vec!["Method".to_owned(), "Mean NIS".to_owned()];
    head.extend(segments.iter().map(|s| format!("Displacement, {s} [µm]")));
    head.extend(loads.iter().map(|load| format!("NMAE {load} [%]")));
    let rows = choices.iter().map(|(choice, evaluation)| {
        let mut row = vec![choice.method.name().to_owned(), cell(evaluation.nis_mean)];
        row.extend(
            segments
                .iter()
                .map(|s| cell(evaluation.displacement_um.get(*s).copied())),
        );
        row.extend(
            loads
                .iter()
                .map(|load| cell(evaluation.nmae_percent[*load]["full"])),
        );
        row
    });
    Table {
        caption:
            "On the recording that it is evaluated on: largest error at any node, error of the loads"
                .into(),
        rows: rows.collect(),
        head,
    }
}
