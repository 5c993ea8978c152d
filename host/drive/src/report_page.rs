//! Builds the report page of a diagnosis of a drive: verdict, effects found, errors, and plots of
//! the remaining residual in the recordings that took no part in the fit.

use loadtwin_machine::{Balance, Machine, Regime};
use loadtwin_report::{
    Axis, Data, EffectSize, Finding, KeyFigure, Mark, Plot, PlotSize, Report, Role, ScatterSample,
    Section, Series, Table,
};

use crate::{BeforeAfter, Diagnosis, Figure, FoundEffect, Residuals};

/// Points of a plot.
const POINTS: usize = 3000;

/// The report on `diagnosis`.
pub fn page(machine: &Machine, balance: &Balance, diagnosis: &Diagnosis) -> Report {
    let unit = balance.unit.symbol();
    let errors = &diagnosis.error;
    Report {
        title: format!("{}: diagnosis", machine.name),
        facts: facts(diagnosis),
        key_figures: KeyFigure::of_errors(
            [errors.nominal.before, errors.nominal.after],
            [errors.recalibrated.before, errors.recalibrated.after],
            key_figure,
        ),
        tables: (findings(diagnosis, unit).into_iter())
            .chain([error_table(diagnosis)])
            .collect(),
        sections: vec![
            residuals(balance, diagnosis, unit),
            Section {
                title: "Linear part, and each recording".into(),
                open: true,
                tables: std::iter::once(linear(balance, diagnosis, unit))
                    .chain((!diagnosis.validated_on.is_empty()).then(|| by_recording(diagnosis)))
                    .collect(),
                ..Section::default()
            },
        ],
        ..Report::default()
    }
}

fn residuals(balance: &Balance, diagnosis: &Diagnosis, unit: &str) -> Section {
    Section {
            title: "Residual of the drive".into(),
            note: "What the model leaves of recordings that took no part in the fit, with the linear part fitted \
                   anew: before without effects, after with what was found."
                .into(),
            open: true,
            plots: plots(balance, diagnosis, unit),
        ..Section::default()
    }
}

fn facts(diagnosis: &Diagnosis) -> Vec<[String; 2]> {
    let names: Vec<&str> = diagnosis.effects.iter().map(|e| e.name).collect();
    let verdict = match diagnosis.verdict {
        "none" => "nothing is missing that these recordings show".to_owned(),
        "unknown" => "something is missing that no effect explains".to_owned(),
        "inseparable" => format!("missing: {}, or another in place of one", names.join(", ")),
        _ => format!("missing: {}", names.join(", ")),
    };
    let validated: Vec<&str> = (diagnosis.validated_on.iter())
        .map(|v| v.recording.as_str())
        .collect();
    let mut facts = vec![
        ["Verdict".into(), verdict],
        ["Fitted to".into(), diagnosis.fitted_on.join(", ")],
        ["Validated on".into(), validated.join(", ")],
        ["Below".into(), format!("{} Hz", diagnosis.cutoff_hz)],
    ];
    // Else it stands with the effect that it is about.
    if diagnosis.alternatives.is_empty() {
        let next = diagnosis.next_experiment.iter();
        facts.extend(next.map(|next| ["Record next".into(), next.clone()]));
    }
    facts.extend((diagnosis.notes.iter()).map(|note| ["Note".into(), note.clone()]));
    facts.extend(diagnosis.beyond.iter().map(|b| {
        let value = format!(
            "{} up to {:.3}, fitted up to {:.3}",
            b.what, b.validated, b.fitted
        );
        ["Extrapolated".into(), value]
    }));
    facts
}

fn key_figure(label: String, figure: Figure) -> Option<KeyFigure> {
    let interval = figure
        .interval_percent
        .map_or_else(String::new, |[low, high]| {
            format!("{low:.1} to {high:.1} % on as many other recordings (95 %); ")
        });
    Some(KeyFigure {
        label,
        value: format!("{:.1} %", figure.value_percent?),
        note: format!("{interval}RMS over that of the drive"),
    })
}

/// A table of each effect found.
fn findings(diagnosis: &Diagnosis, unit: &str) -> Vec<Table> {
    let all = diagnosis.effects.len();
    let caption = |k: usize| match all {
        1 => "What was found, with its 95 % interval".to_owned(),
        _ => format!("What was found, {} of {all}, with its 95 % interval", k + 1),
    };
    (diagnosis.effects.iter().enumerate())
        .map(|(k, effect)| finding(diagnosis, effect, unit).table(caption(k)))
        .collect()
}

fn finding(diagnosis: &Diagnosis, effect: &FoundEffect, unit: &str) -> Finding {
    let of = &effect.parameters;
    let size = |parameter: String, value: f64, std: Option<f64>| EffectSize {
        channel: String::new(),
        parameter,
        value,
        std,
    };
    let terms = (of.terms.iter())
        .map(|(term, value)| size(format!("{term} [{unit} per term]"), *value, None));
    let shape = (of.shape_names.iter().zip(&of.shape).zip(&of.shape_std))
        .map(|((name, value), std)| size(name.clone(), *value, *std));
    let change = |of: &BeforeAfter| {
        let [before, after] = [of.before, of.after].map(|figure| figure.value_percent);
        before
            .zip(after)
            .map_or_else(String::new, |(before, after)| {
                format!("{before:.1} → {after:.1} % of the drive's RMS")
            })
    };
    let evidence = &effect.evidence;
    let with_all = if diagnosis.effects.len() > 1 {
        " with all effects"
    } else {
        ""
    };
    let instead = (diagnosis.alternatives.iter()).filter(|of| of.effect == effect.name);
    let alternatives: Vec<String> = instead
        .flat_map(|of| of.instead.iter().map(|(name, _)| (*name).to_owned()))
        .collect();
    Finding {
        effect: effect.name.to_owned(),
        place: effect.channels.join(", "),
        sizes: terms.chain(shape).collect(),
        errors: vec![
            [
                format!("Error as described{with_all}"),
                change(&diagnosis.error.nominal),
            ],
            [
                format!("Error recalibrated{with_all}"),
                change(&diagnosis.error.recalibrated),
            ],
            [
                "Falls when it is added last".into(),
                format!(
                    "by {:.1} %; probability by chance {:.1e}",
                    evidence.gain_percent, evidence.p_value
                ),
            ],
        ],
        next_recording: (diagnosis.next_experiment.clone()).filter(|_| !alternatives.is_empty()),
        alternatives,
    }
}

/// The linear part, as described and fitted anew.
fn linear(balance: &Balance, diagnosis: &Diagnosis, unit: &str) -> Table {
    let fitted = &diagnosis.recalibrated;
    let mut rows = vec![
        (format!("offset [{unit}]"), balance.offset, fitted.offset),
        (
            "inertia [per acceleration]".into(),
            balance.inertia,
            fitted.inertia,
        ),
        ("drag [per speed]".into(), balance.drag, fitted.drag),
    ];
    let loads = balance.loads.iter().zip(&fitted.load_gains);
    rows.extend(loads.map(|(load, gain)| (format!("factor of {}", load.name), 1.0, *gain)));
    Table {
        caption: "Linear part, fitted together with the effects".into(),
        head: ["", "as described", "fitted"].map(String::from).to_vec(),
        rows: (rows.into_iter())
            .map(|(name, before, after)| vec![name, significant(before), significant(after)])
            .collect(),
    }
}

fn error_table(diagnosis: &Diagnosis) -> Table {
    let cell = |figure: &Figure| match (figure.value_percent, figure.interval_percent) {
        (None, _) => "–".to_owned(),
        (Some(value), None) => format!("{value:.1}"),
        (Some(value), Some([low, high])) => format!("{value:.1} ({low:.1} to {high:.1})"),
    };
    let errors = &diagnosis.error;
    let row =
        |name: &str, of: &BeforeAfter| vec![name.to_owned(), cell(&of.before), cell(&of.after)];
    Table {
        caption: "Error on the validation recordings [% of the drive's RMS], 95 % interval on as many others".into(),
        head: ["Linear part", "without effects", "with effects"]
            .map(String::from)
            .to_vec(),
        rows: vec![
            row("as described", &errors.nominal),
            row("recalibrated", &errors.recalibrated),
            row(
                "recalibrated, each without its mean",
                &errors.recalibrated_own_offset,
            ),
        ],
    }
}

fn by_recording(diagnosis: &Diagnosis) -> Table {
    Table {
        caption: "Error by recording [% of the drive's RMS]".into(),
        head: ["Recording", "without effects", "with effects"]
            .map(String::from)
            .to_vec(),
        rows: (diagnosis.validated_on.iter())
            .map(|v| {
                vec![
                    v.recording.clone(),
                    format!("{:.1}", v.before_percent),
                    format!("{:.1}", v.after_percent),
                ]
            })
            .collect(),
    }
}

/// The residual over what it may depend on, and over time for a recording in motion.
fn plots(balance: &Balance, diagnosis: &Diagnosis, unit: &str) -> Vec<Plot> {
    let of = &diagnosis.residuals;
    let (travel, rate) = if balance.is_angle() {
        ("rad", "rad/s")
    } else {
        ("m", "m/s")
    };
    let mut plots = Vec::new();
    if balance.regime == Regime::Moving {
        for (k, recording) in diagnosis.validated_on.iter().enumerate() {
            plots.extend(over_time(of, k, &recording.recording, unit));
        }
    }
    plots.extend([
        over(of, Axis::new("Speed", rate), &of.speed, unit),
        over(of, Axis::new("Position", travel), &of.position, unit),
        over(of, Axis::new("Drive", unit), &of.drive, unit),
    ]);
    plots
}

/// Drive and residual of recording number `k` over time.
fn over_time(of: &Residuals, k: usize, recording: &str, unit: &str) -> [Plot; 2] {
    let rows: Vec<usize> = (0..of.t.len()).filter(|i| of.recording[*i] == k).collect();
    let at = |values: &[f64]| rows.iter().map(|i| values[*i]).collect::<Vec<f64>>();
    let plot = |quantity: &str, series| Plot {
        title: format!("{quantity} over time, {recording}"),
        y: Axis::new(quantity, unit),
        data: Data::Own {
            x: at(&of.t),
            series,
        },
        ..Plot::default()
    };
    [
        plot(
            "Drive",
            vec![(Series::line("drive", Role::Measured), at(&of.drive))],
        ),
        plot(
            "Residual",
            vec![
                (Series::line("before", Role::Innovation), at(&of.before)),
                (Series::line("after", Role::Estimate), at(&of.after)),
            ],
        ),
    ]
}

/// The residual before and after over the values of `axis`.
fn over(of: &Residuals, axis: Axis, values: &[f64], unit: &str) -> Plot {
    let mut sample = ScatterSample::new(POINTS);
    for (i, x) in values.iter().enumerate() {
        sample.push(&[*x, of.before[i], of.after[i]]);
    }
    let mut columns = sample.columns().into_iter();
    let mut next = || columns.next().unwrap_or_default();
    let (x, before, after) = (next(), next(), next());
    let points = |label: &str, role| Series::new(label, role, Mark::Points);
    Plot {
        title: format!("over {}", axis.quantity.to_lowercase()),
        size: PlotSize::Half,
        x: axis,
        y: Axis::new("Residual", unit),
        data: Data::Own {
            x,
            series: vec![
                (points("before", Role::Innovation), before),
                (points("after", Role::Estimate), after),
            ],
        },
        ..Plot::default()
    }
}

/// Four significant digits, with an exponent where it is far from 1.
fn significant(value: f64) -> String {
    if value == 0.0 || !(1e-3..1e5).contains(&value.abs()) {
        return if value == 0.0 {
            "0".into()
        } else {
            format!("{value:.3e}")
        };
    }
    loadtwin_report::significant(value)
}
