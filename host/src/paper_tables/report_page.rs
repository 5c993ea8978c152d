//! Makes the HTML page of `loadtwin tables` (`page`): tables with the paper's errors beside ours,
//! and plots of error and innovation norm over the process noise Qd.

use super::{Cell, Curve, Point, Published, SEGMENTS, TABLE_2, TABLE_3, mean_qd, statistics};
use crate::machine::Machine;
use crate::report::{Axis, Data, Mark, Plot, PlotSize, Report, Role, Section, Series, Table};

const NOTE: &str = "Lines: the same sensors with other Qd. Points: what each method chose, and what the paper \
     chose and found. A method that follows the innovations goes to a high Qd where the strain \
     model errs over the carrier angle; one that wants the response 1 up to a frequency above \
     the first torsional mode goes where noise alone is left.";

/// The page on `cells` and `curves`, for each individual those of `rows` and of each set of table
/// 3.
pub fn page(
    machine: &Machine,
    effects: &[String],
    rows: &[Published],
    cells: &[Vec<Cell>],
    curves: &[Vec<Curve>],
) -> Report {
    let of_row = |i: usize| cells.iter().map(|row| &row[i]).collect::<Vec<_>>();
    let table = |caption: &str, first: usize, count: usize| Table {
        caption: caption.into(),
        head: ["Sensors", "Tuning", "log10 Qd"]
            .map(String::from)
            .into_iter()
            .chain(SEGMENTS.map(|segment| segment.replace('_', " ")))
            .collect(),
        rows: (first..first + count)
            .map(|i| table_row(&rows[i], &of_row(i)))
            .collect(),
    };
    let (second, third) = (TABLE_2.len(), TABLE_3.len());
    let sets = curves.first().map_or(0, Vec::len);
    Report {
        title: "Virtual torque sensing, as in the paper's tables".into(),
        facts: vec![
            ["Machine".into(), machine.name.clone()],
            ["Individuals".into(), cells.len().to_string()],
            ["Effects that the model lacks".into(), effects.join(", ")],
            [
                "Figures".into(),
                "NMAE of the main shaft, % of nominal: ours, mean ± deviation of individuals (the paper's)".into(),
            ],
        ],
        tables: vec![
            table("Table 2: sets of sensors", 0, second),
            table("Table 3: methods of tuning", second, third),
            table("Not in the paper", second + third, rows.len() - second - third),
        ],
        sections: vec![Section {
            title: "Why methods of tuning differ".into(),
            note: NOTE.into(),
            open: true,
            tables: Vec::new(),
            plots: (0..sets)
                .flat_map(|set| {
                    let of_set: Vec<&Curve> = curves.iter().map(|c| &c[set]).collect();
                    let chosen: Vec<(&Published, Vec<&Cell>)> = rows
                        .iter()
                        .enumerate()
                        .skip(second)
                        .filter(|(_, row)| row.sensors == of_set[0].sensors && !row.drift)
                        .map(|(i, row)| (row, of_row(i)))
                        .collect();
                    [error_plot(&of_set, &chosen), innovation_plot(&of_set)]
                })
                .collect(),
        }],
        ..Report::default()
    }
}

fn table_row(row: &Published, cells: &[&Cell]) -> Vec<String> {
    let qd: Vec<String> = mean_qd(cells).iter().map(|qd| format!("{qd:.1}")).collect();
    let mut text = vec![row.sensors.into(), row.tuning(), qd.join(", ")];
    text.extend((0..SEGMENTS.len()).map(|k| {
        let (mean, std) = statistics(cells.iter().map(|cell| cell.nmae[k]));
        let paper = row.nmae.map(|nmae| format!(" ({:.2})", nmae[k]));
        format!("{mean:.2} ± {std:.2}{}", paper.unwrap_or_default())
    }));
    text
}

/// Mean over individuals of `value` at each point.
fn mean(curves: &[&Curve], value: impl Fn(&Point) -> f64) -> Vec<f64> {
    (0..curves[0].points.len())
        .map(|i| statistics(curves.iter().map(|curve| value(&curve.points[i]))).0)
        .collect()
}

fn error_plot(curves: &[&Curve], chosen: &[(&Published, Vec<&Cell>)]) -> Plot {
    let ours = chosen.iter().map(|(_, cells)| {
        let (nmae, _) = statistics(cells.iter().map(|cell| cell.nmae[0]));
        (mean_qd(cells)[0], nmae)
    });
    let papers = chosen
        .iter()
        .filter_map(|(row, _)| Some((row.log10_qd?[0], row.nmae?[0])));
    let line = mean(curves, |point| point.log10_qd)
        .into_iter()
        .zip(mean(curves, |point| point.nmae));
    let kinds: [Vec<(f64, f64)>; 3] = [line.collect(), ours.collect(), papers.collect()];
    let mut x: Vec<f64> = kinds.iter().flatten().map(|(at, _)| *at).collect();
    x.sort_by(f64::total_cmp);
    let at_points = |points: &[(f64, f64)]| {
        let value = |x: &f64| points.iter().find(|(at, _)| at == x).map(|(_, v)| *v);
        x.iter().map(|x| value(x).unwrap_or(f64::NAN)).collect()
    };
    let along_line = |x: &f64| {
        let line = &kinds[0];
        let i = line
            .partition_point(|(at, _)| at < x)
            .clamp(1, line.len() - 1);
        let ((a, low), (b, high)) = (line[i - 1], line[i]);
        let u = (x - a) / (b - a);
        if (0.0..=1.0).contains(&u) {
            low.powf(1.0 - u) * high.powf(u)
        } else {
            f64::NAN
        }
    };
    let series = vec![
        (
            Series::line("any Qd", Role::Estimate),
            x.iter().map(along_line).collect(),
        ),
        (
            Series::new("chosen here", Role::Measured, Mark::Points),
            at_points(&kinds[1]),
        ),
        (
            Series::new("the paper's", Role::Reference, Mark::Points),
            at_points(&kinds[2]),
        ),
    ];
    Plot {
        title: format!("{}: error", curves[0].sensors),
        size: PlotSize::Half,
        x: Axis::new("log10 Qd of the main shaft", ""),
        y: Axis {
            logarithmic: true,
            ..Axis::new("NMAE", "%")
        },
        data: Data::Own { x, series },
        ..Plot::default()
    }
}

fn innovation_plot(curves: &[&Curve]) -> Plot {
    Plot {
        title: format!("{}: innovations", curves[0].sensors),
        size: PlotSize::Half,
        x: Axis::new("log10 Qd of the main shaft", ""),
        y: Axis {
            logarithmic: true,
            ..Axis::new("Innovation norm", "")
        },
        data: Data::Own {
            x: mean(curves, |point| point.log10_qd),
            series: vec![(
                Series::line("mean square over R", Role::Innovation),
                mean(curves, |point| point.innovation),
            )],
        },
        ..Plot::default()
    }
}
