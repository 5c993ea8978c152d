//! Makes the HTML page of `loadtwin life` (`report`): tables of counts and damage-equivalent loads;
//! for each load plots of cumulative cycles, rainflow matrix, level crossings, time and turns at
//! load.

use std::path::PathBuf;

use loadtwin_common::counting::{BINS, LevelScale, LoadCounts, SHAFTS, TURN_BINS};

use super::count::Counted;
use super::figures::Figures;
use crate::cli::printing::shown_all;
use crate::report::{
    Axis, Data, KeyFigure, Mark, Plot, PlotSize, Report, Role, Section, Series, Table, prefix_of,
    significant,
};

const NOTE: &str = "Matrix: one mark a cell, by its minimum and maximum, with the number of its closed cycles. \
     Cumulative cycles: how many have at least that range, half cycles of the residue with them.";

/// Decades of cycles that have a series of their own in the matrix; the last has all above.
const DECADES: [(&str, Role); 5] = [
    ("1 to 9", Role::Other),
    ("10 to 99", Role::Estimate),
    ("100 to 999", Role::Measured),
    ("1000 to 9999", Role::Reference),
    ("1e4 and more", Role::Innovation),
];

/// The page on all loads.
pub(super) fn report(
    files: &[PathBuf],
    counted: &[Counted],
    figures: &[Figures],
    period_s: f64,
) -> Report {
    let seen_s = figures.first().map_or(0.0, |figures| figures.seen_s);
    let of_loads = || counted.iter().zip(figures);
    Report {
        title: "Load cycles and damage".into(),
        facts: vec![
            ["Files".into(), shown_all(files).join(", ")],
            ["Time seen".into(), format!("{seen_s:.1} s")],
        ],
        key_figures: of_loads().filter_map(key_figure).collect(),
        tables: std::iter::once(counts_table(counted, period_s))
            .chain(of_loads().map(equivalent_loads))
            .collect(),
        sections: (counted.iter())
            .map(|counted| section(counted, period_s))
            .collect(),
        ..Report::default()
    }
}

fn key_figure((counted, figures): (&Counted, &Figures)) -> Option<KeyFigure> {
    let damage = figures.damage?;
    let note = figures
        .damage_noise_removed
        .map_or(String::new(), |removed| {
            format!(
                "noise removed {:.3e} ({:.3e} to {:.3e})",
                removed.value, removed.lower, removed.upper
            )
        });
    Some(KeyFigure {
        label: format!("{}: damage by the S-N curve", counted.name),
        value: format!("{damage:.3e}"),
        note,
    })
}

/// What was seen and counted of each load of each machine.
fn counts_table(counted: &[Counted], period_s: f64) -> Table {
    let several = counted.iter().any(|counted| counted.machines.len() > 1);
    let mut rows = Vec::new();
    for counted in counted {
        for (number, machine) in (1..).zip(&counted.machines) {
            let counts = &machine.counts;
            let (seen, scale) = (counts.observation(), counts.scale());
            let (closed, residue) = counts.ended();
            let [from, to] = scale.ends();
            let (prefix, factor) = prefix_of(f64::from(from.abs().max(to.abs())));
            let size = |load: f32| significant(f64::from(load) / factor);
            let name = if several {
                format!("{}, machine {number}", counted.name)
            } else {
                counted.name.clone()
            };
            let extremes = counts.extremes().map_or_else(
                || ["–".to_owned(), "–".to_owned()],
                |extremes| extremes.map(|extreme| size(extreme.load)),
            );
            let [lowest, highest] = extremes;
            rows.push(vec![
                name,
                format!("{prefix}{}", counted.unit),
                closed.cycles().to_string(),
                residue.ranges().count().to_string(),
                lowest,
                highest,
                format!("{} to {}", size(from), size(to)),
                size(f32::from(counts.gate()) * scale.width()),
                format!("{:.2}", 100.0 * seen.share().unwrap_or(0.0)),
                format!("{:.1}", seen.elapsed() as f64 * period_s),
                seen.not_valid.to_string(),
                format!("{} in {}", seen.missing, seen.gaps),
            ]);
        }
    }
    Table {
        caption: "What was counted".into(),
        head: [
            "Load",
            "unit",
            "closed cycles",
            "half cycles",
            "lowest",
            "highest",
            "counted range",
            "gate",
            "seen [%]",
            "of [s]",
            "samples not valid",
            "missing, gaps",
        ]
        .map(String::from)
        .to_vec(),
        rows,
    }
}

fn equivalent_loads((counted, figures): (&Counted, &Figures)) -> Table {
    let largest = figures
        .equivalent
        .iter()
        .map(|of| of.load)
        .fold(0.0, f64::max);
    let (prefix, factor) = prefix_of(largest);
    let size = |load: f64| significant(load / factor);
    let unit = format!("{prefix}{}", counted.unit);
    let mut head = vec!["Exponent".into(), format!("As estimated [{unit}]")];
    if counted.noise_removed.is_some() {
        head.push(format!("Noise removed [{unit}]"));
        head.push(format!("90 % interval [{unit}]"));
    }
    let rows = figures.equivalent.iter().map(|of| {
        let mut row = vec![of.exponent.to_string(), size(of.load)];
        if let Some(removed) = of.noise_removed {
            row.push(size(removed.value));
            row.push(format!(
                "{} to {}",
                size(removed.lower),
                size(removed.upper)
            ));
        }
        row
    });
    Table {
        caption: format!(
            "{}: range of {:.0} equal cycles of the same damage",
            counted.name, figures.equivalent_cycles
        ),
        head,
        rows: rows.collect(),
    }
}

fn section(counted: &Counted, period_s: f64) -> Section {
    let Some(first) = counted.machines.first() else {
        return Section::default();
    };
    let scale = *first.counts.scale();
    let machines: Vec<&LoadCounts> = (counted.machines.iter())
        .map(|machine| &machine.counts)
        .collect();
    let load = Axis::new("Load", counted.unit.symbol());
    let mut plots = vec![
        cumulative(counted),
        matrix(&machines, scale, counted.unit.symbol()),
        crossings(&machines, scale, load.clone()),
        time_at_load(&machines, scale, load.clone(), period_s),
    ];
    plots.extend(turns_at_load(&machines, scale, load));
    Section {
        title: counted.name.clone(),
        note: NOTE.into(),
        open: true,
        tables: Vec::new(),
        plots,
    }
}

fn logarithmic(quantity: &str, unit: &str) -> Axis {
    Axis {
        logarithmic: true,
        ..Axis::new(quantity, unit)
    }
}

fn half(title: &str, x: Axis, y: Axis, data: Data) -> Plot {
    Plot {
        title: title.into(),
        size: PlotSize::Half,
        x,
        y,
        data,
        ..Plot::default()
    }
}

/// From the largest range on, so that the number of cycles rises.
fn cumulative(counted: &Counted) -> Plot {
    let mut cycles: Vec<_> = counted.spectrum.cycles().collect();
    cycles.reverse();
    let numbers = cycles.iter().scan(0.0, |sum, cycle| {
        *sum += cycle.count;
        Some(*sum)
    });
    let ranges = cycles.iter().map(|cycle| cycle.range).collect();
    half(
        "Range over cumulative cycles",
        logarithmic("Cumulative cycles", ""),
        Axis::new("Range", counted.unit.symbol()),
        Data::Own {
            x: numbers.collect(),
            series: vec![(Series::line("range", Role::Estimate), ranges)],
        },
    )
}

/// Middle of a bin, of `bins` over the scale.
fn middle(scale: LevelScale, bin: usize, bins: usize) -> f64 {
    let [from, to] = scale.ends().map(f64::from);
    from + (bin as f64 + 0.5) * (to - from) / bins as f64
}

fn matrix(machines: &[&LoadCounts], scale: LevelScale, unit: &str) -> Plot {
    let mut cells = vec![0_u64; BINS * BINS];
    for counts in machines {
        for (low, high, count) in counts.ended().0.matrix().cells() {
            cells[low * BINS + high] += count;
        }
    }
    let found: Vec<(usize, u64)> = (cells.into_iter().enumerate())
        .filter(|(_, count)| *count > 0)
        .collect();
    let of_decade = |decade: usize| {
        let value = |&(cell, count): &(usize, u64)| {
            if (count.ilog10() as usize).min(DECADES.len() - 1) == decade {
                middle(scale, cell % BINS, BINS)
            } else {
                f64::NAN
            }
        };
        found.iter().map(value).collect()
    };
    let series = DECADES
        .iter()
        .enumerate()
        .map(|(decade, (label, role))| (Series::new(label, *role, Mark::Points), of_decade(decade)))
        .collect();
    let plot = half(
        "Rainflow matrix, cycles",
        Axis::new("Minimum", unit),
        Axis::new("Maximum", unit),
        Data::Own {
            x: (found.iter())
                .map(|(cell, _)| middle(scale, cell / BINS, BINS))
                .collect(),
            series,
        },
    );
    Plot {
        names: found.iter().map(|(_, count)| count.to_string()).collect(),
        ..plot
    }
}

fn crossings(machines: &[&LoadCounts], scale: LevelScale, load: Axis) -> Plot {
    let mut sum = [0.0; BINS - 1];
    for counts in machines {
        for (sum, count) in sum.iter_mut().zip(counts.level_crossings()) {
            *sum += count as f64;
        }
    }
    let [from, to] = scale.ends().map(f64::from);
    let edge = |bin: usize| from + bin as f64 * (to - from) / BINS as f64;
    half(
        "Level crossings upwards",
        load,
        logarithmic("Crossings", ""),
        Data::Own {
            x: (1..BINS).map(edge).collect(),
            series: vec![(Series::line("crossings", Role::Estimate), sum.to_vec())],
        },
    )
}

fn time_at_load(machines: &[&LoadCounts], scale: LevelScale, load: Axis, period_s: f64) -> Plot {
    let time_s = |bin: usize| {
        let samples: u64 = machines.iter().map(|counts| counts.time().get(bin)).sum();
        samples as f64 * period_s
    };
    half(
        "Time at load",
        load,
        Axis::new("Time", "s"),
        Data::Own {
            x: (0..BINS).map(|bin| middle(scale, bin, BINS)).collect(),
            series: vec![(
                Series::new("time", Role::Estimate, Mark::Bars),
                (0..BINS).map(time_s).collect(),
            )],
        },
    )
}

/// The load-revolution distribution of each shaft that turned.
fn turns_at_load(machines: &[&LoadCounts], scale: LevelScale, load: Axis) -> Option<Plot> {
    let turns = |shaft: usize, bin: usize| -> f64 {
        let of_shaft = machines
            .iter()
            .filter_map(|counts| counts.turns().get(shaft));
        of_shaft.map(|turns| turns.turns(bin)).sum()
    };
    let shafts: [(&str, Role); SHAFTS] =
        [("shaft 1", Role::Estimate), ("shaft 2", Role::Reference)];
    let series: Vec<_> = (shafts.into_iter().enumerate())
        .map(|(shaft, (label, role))| {
            let turns: Vec<f64> = (0..TURN_BINS).map(|bin| turns(shaft, bin)).collect();
            (Series::new(label, role, Mark::Bars), turns)
        })
        .filter(|(_, turns)| turns.iter().any(|turns| *turns > 0.0))
        .collect();
    (!series.is_empty()).then(|| {
        half(
            "Turns at load",
            load,
            Axis::new("Turns", ""),
            Data::Own {
                x: (0..TURN_BINS)
                    .map(|bin| middle(scale, bin, TURN_BINS))
                    .collect(),
                series,
            },
        )
    })
}
