//! Builds the report page of `loadtwin tune` for a drivetrain: hold-out comparison, load noise,
//! frequency response, measurement noise of the channels.

use crate::tune::{Check, MeasurementNoise, NOISE_BINS, Tuned};
use loadtwin_machine::Machine;
use loadtwin_report::{
    Axis, Data, FigureRow, Limit, Plot, PlotSize, Report, Role, Section, Series, Table,
};

/// The report on `sets` of sensors tuned for loads up to `cutoff_hz`, with the
/// measured noise of channels, each by its number in `machine`, and the sets on the hold-out data.
pub fn page(
    machine: &Machine,
    cutoff_hz: f64,
    noise: &[(usize, MeasurementNoise)],
    sets: &[(&str, &Tuned)],
    checks: &[Check],
) -> Report {
    let loads: Vec<&str> = (machine.drivetrain.iter().flat_map(|d| &d.loads))
        .map(|load| load.name.as_str())
        .collect();
    Report {
        title: format!("Tuning of {}", machine.name),
        facts: vec![["Cut-off frequency".into(), format!("{cutoff_hz} Hz")]],
        tables: vec![holdout(checks), chosen(&loads, sets)],
        sections: vec![
            Section {
                title: "Frequency response".into(),
                note: format!(
                    "From the true to the estimated load, by the noise of the table's first method; the median \
                     over the carrier angle. 1 is wanted below the cut-off of {cutoff_hz} Hz, 0 above."
                ),
                open: true,
                tables: Vec::new(),
                plots: sets
                    .iter()
                    .map(|(name, tuned)| response(&loads, name, tuned, cutoff_hz))
                    .collect(),
            },
            Section {
                title: "Noise of the channels".into(),
                note: "Error of the model over the carrier angle, eq. (15) to (18).".into(),
                open: false,
                tables: Vec::new(),
                plots: noise.iter().map(|n| over_angle(machine, n)).collect(),
            },
        ],
        ..Report::default()
    }
}

fn chosen(loads: &[&str], sets: &[(&str, &Tuned)]) -> Table {
    let head = ["Sensors", "Method"].map(String::from).into_iter();
    let norms = ["Innovation norm", "Solution norm", "Misfit"].map(String::from);
    let qd = loads.iter().map(|load| format!("log10 Qd {load}"));
    let rows = sets.iter().flat_map(|(name, tuned)| {
        tuned.methods.iter().map(|(method, noise)| {
            let norms = noise.outcome.map(|o| [o.innovation, o.load, o.misfit]);
            let mut row = vec![(*name).to_owned(), method.name().to_owned()];
            row.extend(noise.log10_qd.iter().map(|qd| format!("{qd:.2}")));
            row.extend((0..3).map(|k| norms.map_or("–".into(), |n| format!("{:.3}", n[k]))));
            row
        })
    });
    Table {
        caption:
            "Variance Qd of the loads' steps in one sample [(Nm)²], and the innovations with it"
                .into(),
        head: head.chain(qd).chain(norms).collect(),
        rows: rows.collect(),
    }
}

/// Frequency (Hz) up to which the response of load `j` is not below `1 / sqrt(2)` (-3 dB); none where
/// already the lowest is.
pub fn reached_hz(response: &[(f64, Vec<f64>)], j: usize) -> Option<f64> {
    (response.iter())
        .take_while(|(_, h)| {
            h.get(j)
                .is_some_and(|h| *h >= std::f64::consts::FRAC_1_SQRT_2)
        })
        .last()
        .map(|(f, _)| *f)
}

/// Error and likelihood of each set on the hold-out data.
fn holdout(checks: &[Check]) -> Table {
    let mut rows = Vec::new();
    for check in checks {
        let tuned = check.tuned.iter().map(|c| ("tuned", c));
        let measured = check.measured.iter().map(|c| ("walk as described", c));
        for (noise, comparison) in tuned.chain(measured) {
            let no_worse = if comparison.is_shown_no_worse() {
                "yes"
            } else {
                "no"
            };
            rows.push(FigureRow {
                first: vec![check.sensors.clone(), noise.into()],
                figures: comparison.rows(),
                last: vec![no_worse.into()],
            });
        }
    }
    Table::of_figures(
        "Before → after on the hold-out data (95 % interval of the difference)".into(),
        [&["Sensors", "Noise"], &["No worse"]],
        &rows,
    )
}

fn response(loads: &[&str], name: &str, tuned: &Tuned, cutoff_hz: f64) -> Plot {
    let of_load = |j: usize| tuned.response.iter().map(|(_, h)| h[j]).collect();
    Plot {
        title: name.to_owned(),
        size: PlotSize::Half,
        x: Axis {
            logarithmic: true,
            ..Axis::new("Frequency", "Hz")
        },
        y: Axis::new("|H|", ""),
        data: Data::Own {
            x: tuned.response.iter().map(|(f, _)| *f).collect(),
            series: (loads.iter().enumerate())
                .map(|(j, load)| {
                    let role = [Role::Estimate, Role::Measured, Role::Other][j.min(2)];
                    (Series::line(load, role), of_load(j))
                })
                .collect(),
        },
        limits: vec![Limit {
            label: format!("wanted below {cutoff_hz} Hz"),
            value: 1.0,
        }],
        ..Plot::default()
    }
}

fn over_angle(machine: &Machine, (channel, noise): &(usize, MeasurementNoise)) -> Plot {
    let channel = &machine.channels[*channel];
    let own = |values: &[f64]| values.iter().map(|v| channel.unit.from_si(*v)).collect();
    Plot {
        title: channel.name.clone(),
        size: PlotSize::Third,
        x: Axis::new("Carrier angle", "°"),
        y: Axis::new("Standard deviation", channel.unit.symbol()),
        data: Data::Own {
            x: (0..NOISE_BINS)
                .map(|i| 360.0 * (i as f64 + 0.5) / NOISE_BINS as f64)
                .collect(),
            series: vec![
                (
                    Series::line("scaled by torque, eq. (17)", Role::Estimate),
                    own(&noise.scaled),
                ),
                (
                    Series::line("as it is, eq. (15)", Role::Other),
                    own(&noise.plain),
                ),
            ],
        },
        ..Plot::default()
    }
}
