//! Builds the report page of a diagnosis: verdict, effects found, check of the filter, plots of the
//! three main residuals before and after over each covariate, ranking of candidates, tests of
//! residuals and innovations.

use crate::assessment::verdict::cannot_show;
use crate::candidate_effect::Scope;
use crate::diagnosable::Diagnosable;
use crate::diagnosis::Diagnosis;
use crate::diagnosis_report::findings::findings;
use crate::filter_check::FilterCheck;
use crate::{Innovations, Interval, Verdict};
use loadtwin_machine::Machine;
use loadtwin_replay::Comparison;
use loadtwin_report::{
    Axis, Data, FigureRow, KeyFigure, Mark, Plot, PlotSize, Report, Role, ScatterSample, Section,
    Series, Table,
};

/// Points of a plot.
const POINTS: usize = 3000;

/// Verdict, ranking, errors, and the residuals before and after over each covariate of the first
/// recording.
pub fn page<S: Diagnosable>(
    machine: &Machine,
    recording: &str,
    diagnosis: &Diagnosis<S>,
    innovations: &[Innovations],
    filter: Option<&FilterCheck>,
) -> Report {
    let errors = &diagnosis.errors;
    Report {
        title: format!("{}: diagnosis", machine.name),
        facts: facts(recording, diagnosis),
        key_figures: KeyFigure::of_errors(
            [errors.nominal.before, errors.nominal.after],
            [errors.recalibrated.before, errors.recalibrated.after],
            |label, figure| {
                Some(KeyFigure {
                    label,
                    value: format!("{:.3} %", figure.value_percent?),
                    note: note(figure),
                })
            },
        ),
        tables: (findings(diagnosis, filter).into_iter())
            .chain(filter.map(filter_table))
            .collect(),
        time: None,
        samples: None,
        sections: top_residuals(diagnosis)
            .into_iter()
            .map(|k| section(diagnosis, k))
            .chain([statistics(diagnosis, innovations)])
            .collect(),
    }
}

/// What the verdict rests on.
fn statistics<S: Diagnosable>(diagnosis: &Diagnosis<S>, innovations: &[Innovations]) -> Section {
    Section {
        title: "Statistics of the verdict".into(),
        open: true,
        tables: [
            ranking(diagnosis),
            residual_table(diagnosis),
            residual_test_table(diagnosis),
            nis_table(innovations),
        ]
        .into_iter()
        .filter(|table| !table.rows.is_empty())
        .collect(),
        ..Section::default()
    }
}

/// Recording and verdict; what is negligible, what the recording does not show.
fn facts<S: Diagnosable>(recording: &str, diagnosis: &Diagnosis<S>) -> Vec<[String; 2]> {
    let selection = &diagnosis.selection;
    let mut facts = vec![
        ["Recording".into(), recording.into()],
        ["Verdict".into(), headline(&diagnosis.verdict)],
    ];
    let mut add = |label: &str, value: String| {
        if !value.is_empty() {
            facts.push([label.into(), value]);
        }
    };
    add(
        "Significant, but negligible for the load",
        selection.negligible_names().join(", "),
    );
    add("Left", diagnosis.remainder().unwrap_or_default());
    add(
        "Not shown by this recording",
        cannot_show(selection).join(", "),
    );
    add(
        "Note",
        diagnosis.recordings[0]
            .remarks(selection)
            .unwrap_or_default(),
    );
    facts
}

/// The estimator before and after.
fn filter_table(check: &FilterCheck) -> Table {
    let of = |sets: &[Comparison], effects: &str| -> Vec<_> {
        let row = |set: &Comparison| {
            let verdict = if set.is_worse() { "worse" } else { "" };
            let first = vec![set.sensors.clone(), effects.to_owned()];
            FigureRow {
                first,
                figures: set.rows(),
                last: vec![verdict.to_owned()],
            }
        };
        sets.iter().map(row).collect()
    };
    let mut rows = of(&check.sets, "all");
    rows.extend(of(
        &check.sets_without,
        &format!("without {}", check.left_out.join(", ")),
    ));
    Table::of_figures(
        format!(
            "Estimator as described → with what was found (95 % interval of the difference), on {}",
            check.data()
        ),
        [&["Sensors", "Effects"], &[""]],
        &rows,
    )
}

/// The verdict in words.
pub fn headline(verdict: &Verdict) -> String {
    match verdict {
        Verdict::None => "nothing is missing that this recording shows".into(),
        Verdict::Effects(names) => format!("missing: {}", names.join(", ")),
        Verdict::Inseparable(names) if names.len() == 1 => {
            format!(
                "missing: {}, and this recording cannot tell where",
                names[0]
            )
        }
        Verdict::Inseparable(names) => format!(
            "one of these, which this recording cannot tell apart: {}",
            names.join(", ")
        ),
        Verdict::Unknown => "something is missing that no candidate explains".into(),
    }
}

fn note(figure: Interval) -> String {
    figure
        .interval_percent
        .map_or_else(String::new, |[low, high]| {
            format!("{low:.3} to {high:.3} %, mean absolute error over nominal")
        })
}

fn ranking<S: Diagnosable>(diagnosis: &Diagnosis<S>) -> Table {
    Table {
        caption: "Candidates: logarithm of the evidence on blocks left out; the largest margin over chance first".into(),
        head: ["Candidate", "what it is", "evidence", "by chance"]
            .map(String::from)
            .to_vec(),
        rows: diagnosis
            .selection
            .ranking
            .iter()
            .map(|r| {
                vec![
                    r.effect.name().into(),
                    r.effect.description().into(),
                    format!("{:.1}", r.score.log_evidence),
                    r.threshold
                        .map_or_else(|| "–".into(), |t| format!("{t:.1}")),
                ]
            })
            .collect(),
    }
}

fn residual_table<S: Diagnosable>(diagnosis: &Diagnosis<S>) -> Table {
    Table {
        caption: "Residuals: mean square over that of the machine without effect".into(),
        head: ["Residual", "before", "after", "mostly at [Hz]", "per turn"]
            .map(String::from)
            .to_vec(),
        rows: diagnosis
            .residual_excesses
            .iter()
            .map(|o| {
                vec![
                    o.channel.clone(),
                    format!("{:.2}", o.before),
                    format!("{:.2}", o.after),
                    format!("{:.1}", o.frequency_hz),
                    format!("{:.1}", o.order),
                ]
            })
            .collect(),
    }
}

fn residual_test_table<S: Diagnosable>(diagnosis: &Diagnosis<S>) -> Table {
    let rows = diagnosis.residual_tests.iter().flat_map(|tests| {
        tests.significant().into_iter().map(|tested| {
            vec![
                tests.channel.clone(),
                tested.to_string(),
                format!("{:.2}", tested.before),
                format!("{:.2}", tested.after),
                tested
                    .by_chance
                    .map_or_else(|| "–".into(), |c| format!("{c:.2}")),
            ]
        })
    });
    Table {
        caption: "What residuals go with, where that is more than chance".into(),
        head: ["Residual", "goes with", "before", "after", "by chance"]
            .map(String::from)
            .to_vec(),
        rows: rows.collect(),
    }
}

fn nis_table(innovations: &[Innovations]) -> Table {
    let figure = |value: Option<f64>| value.map_or_else(|| "–".into(), |v| format!("{v:.2}"));
    let rows = innovations.iter().flat_map(|of| {
        of.of.iter().map(move |sensor| {
            vec![
                of.recording.display().to_string(),
                of.sensors.clone(),
                sensor.sensor.clone(),
                figure(sensor.bias),
                figure(sensor.nis),
                figure(sensor.next),
                format!("{}", sensor.coloured_lags),
            ]
        })
    });
    Table {
        caption:
            "Innovations of the filter as described; the load takes up part of what is missing"
                .into(),
        head: [
            "Recording",
            "sensors",
            "sensor",
            "mean [σ]",
            "NIS",
            "from one to the next",
            "coloured lags of 25",
        ]
        .map(String::from)
        .to_vec(),
        rows: rows.collect(),
    }
}

/// The three residuals of which the effects explain most, or that have the largest excess.
fn top_residuals<S: Diagnosable>(diagnosis: &Diagnosis<S>) -> Vec<usize> {
    let mut order: Vec<usize> = (0..diagnosis.residual_excesses.len()).collect();
    let excess = |k: &usize| {
        let o = &diagnosis.residual_excesses[*k];
        o.before - o.after.min(o.before) + 0.1 * o.after
    };
    order.sort_by(|a, b| excess(b).total_cmp(&excess(a)));
    order.truncate(3);
    order
}

/// Whether a plot over these values shows more than one of them.
fn varies(values: &[f64]) -> bool {
    let known = || values.iter().copied().filter(|x| x.is_finite());
    let (low, high) = (
        known().fold(f64::INFINITY, f64::min),
        known().fold(f64::NEG_INFINITY, f64::max),
    );
    high - low > 1e-3 * low.abs().max(high.abs())
}

fn section<S: Diagnosable>(diagnosis: &Diagnosis<S>, k: usize) -> Section {
    let recording = &diagnosis.recordings[0];
    let (before, after) = (
        recording.residual(k),
        &diagnosis.selection.residuals_after[0][k],
    );
    let unit = recording.unit(k);
    let plots = recording
        .covariates()
        .into_iter()
        .filter(|over| varies(&over.values))
        .map(|over| {
            let mut sample = ScatterSample::new(POINTS);
            for (i, x) in over.values.iter().enumerate() {
                if before[i].is_finite() {
                    sample.push(&[*x, before[i], after[i]]);
                }
            }
            let mut columns = sample.columns().into_iter();
            let mut next = || columns.next().unwrap_or_default();
            Plot {
                title: format!("over {}", over.quantity.to_lowercase()),
                size: PlotSize::Half,
                x: Axis::new(over.quantity, over.unit),
                y: Axis::new("Residual", unit),
                data: Data::Own {
                    x: next(),
                    series: vec![
                        (
                            Series::new("before", Role::Innovation, Mark::Points),
                            next(),
                        ),
                        (Series::new("after", Role::Estimate, Mark::Points), next()),
                    ],
                },
                ..Plot::default()
            }
        })
        .collect();
    let shared = diagnosis
        .selection
        .found
        .iter()
        .any(|f| f.effect.scope() == Scope::Machine);
    Section {
        title: format!("Residual {}", recording.name(k)),
        note: if shared {
            "One set of parameters explains all residuals together.".into()
        } else {
            String::new()
        },
        open: true,
        plots,
        ..Section::default()
    }
}
