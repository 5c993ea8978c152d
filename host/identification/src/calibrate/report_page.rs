//! Builds the report page of a calibration: ranking of gauges, surfaces over torque and angle,
//! simulated against measured sensitivity, Pareto fronts of the gauge selection.

use crate::calibrate::{BINS, Candidate, Gauge, MapSource, Observations, fine, fronts};
use loadtwin_machine::{Channel, Machine};
use loadtwin_report::{
    Axis, Data, KeyFigure, Mark, Plot, PlotSize, Report, Role, Section, Series, Table, prefix_of,
    significant,
};

/// Points over the carrier angle: bins of the moments put together.
const POINTS: usize = 256;

/// Parts of the largest mean torque at which a surface is cut.
const CUTS: [f64; 4] = [0.25, 0.5, 0.75, 1.0];

/// Gauges of one group that were proposed, in the order of their use.
pub struct Proposal {
    /// Name of the group, or `overall`.
    pub group: String,
    /// Gauges that could be used.
    pub candidates: Vec<Candidate>,
    /// Numbers in `candidates`; the first 1, 3, 5 are the proposed sets.
    pub order: Vec<usize>,
}

/// The report on `gauges`, fitted to `observations`.
pub fn page(
    machine: &Machine,
    observations: &Observations,
    gauges: &[Gauge],
    source: MapSource,
    proposals: &[Proposal],
) -> Report {
    let mut ranked: Vec<&Gauge> = gauges.iter().collect();
    ranked.sort_by(|a, b| response(b).total_cmp(&response(a)));
    let faulty = gauges.iter().filter(|gauge| gauge.fault.is_some()).count();
    let figure = |label: &str, value: String, note: &str| KeyFigure {
        label: label.into(),
        value,
        note: note.into(),
    };
    Report {
        title: format!("Calibration of {}", machine.name),
        facts: vec![
            ["Samples".into(), observations.samples.to_string()],
            ["Turns of the carrier".into(), format!("{:.1}", observations.turns)],
        ],
        key_figures: vec![
            figure("Gauges", gauges.len().to_string(), ""),
            figure("Faulty", faulty.to_string(), "named in the table"),
        ],
        tables: std::iter::once(ranking(machine, &ranked))
            .chain((!proposals.is_empty()).then(|| proposed(machine, proposals)))
            .collect(),
        time: None,
        samples: None,
        sections: vec![
            Section {
                title: "Pareto fronts".into(),
                note: "To the right responds more to torque, below is modelled better; gauges on or near the front are proposed.".into(),
                open: true,
                tables: Vec::new(),
                plots: proposals.iter().map(|p| front_plot(machine, p)).collect(),
            },
            Section {
                title: "Simulated and measured".into(),
                note: "Strain over the carrier angle at constant torque, the largest mean of the recordings' angles.".into(),
                open: false,
                tables: Vec::new(),
                plots: ranked
                    .iter()
                    .filter_map(|gauge| compared(machine, observations, gauge, source))
                    .collect(),
            },
            Section {
                title: "Surfaces".into(),
                note: "f_T T f_theta(theta) + d of eq. (1), cut at four torques.".into(),
                open: false,
                tables: Vec::new(),
                plots: ranked
                    .iter()
                    .filter_map(|gauge| surface_plot(machine, observations, gauge))
                    .collect(),
            },
        ],
    }
}

fn response(gauge: &Gauge) -> f64 {
    gauge
        .surface
        .as_ref()
        .map_or(0.0, |s| s.sensitivity().abs())
}

/// Unit for people and its value in SI: um/m for strain, the channel's own otherwise.
fn shown(channel: &Channel) -> (String, f64) {
    if channel.unit.si().symbol() == "m/m" {
        ("µm/m".into(), 1e-6)
    } else {
        (channel.unit.symbol().into(), channel.unit.to_si(1.0))
    }
}

/// Unit of torque in which the machine's loads are read best, and its value in Nm.
fn torque_unit(machine: &Machine) -> (String, f64) {
    let nominal = machine.loads().into_iter().map(|load| load.nominal);
    let (prefix, factor) = prefix_of(nominal.fold(0.0, f64::max));
    (format!("{prefix}Nm"), factor)
}

fn ranking(machine: &Machine, ranked: &[&Gauge]) -> Table {
    let (torque, per_torque) = torque_unit(machine);
    let response = format!("f_T per {torque}");
    let head = [
        "Channel",
        "Group",
        "Unit",
        &response,
        "RMSE",
        "Adjusted R²",
        "Offset",
        "Gain",
        "Node or °",
        "MAE before",
        "MAE",
        "Fault",
    ];
    let rows = ranked.iter().map(|gauge| {
        let channel = &machine.channels[gauge.channel];
        let (unit, si) = shown(channel);
        let number = |value: Option<f64>, digits: usize| {
            // Without the sign of what is rounded to 0.
            let shown = |value: f64| format!("{value:.digits$}");
            let is_zero = |text: &str| text.chars().all(|c| "-0.".contains(c));
            value.map_or("–".to_owned(), |value| match shown(value) {
                text if is_zero(&text) => shown(0.0),
                text => text,
            })
        };
        let (surface, placement) = (gauge.surface.as_ref(), gauge.placement.as_ref());
        let place = placement.map_or("–".to_owned(), |p| {
            p.node
                .clone()
                .unwrap_or_else(|| format!("{:.2}°", p.shift_rad.to_degrees()))
        });
        vec![
            channel.name.clone(),
            channel.group.clone().unwrap_or_default(),
            unit,
            surface.map_or("–".into(), |s| {
                significant(per_torque * s.sensitivity() / si)
            }),
            number(surface.map(|s| s.rmse / si), 3),
            number(surface.map(|s| s.adjusted_r2), 4),
            number(placement.map(|p| p.offset / si), 2),
            number(placement.map(|p| p.gain), 3),
            place,
            number(placement.map(|p| p.mae_before / si), 3),
            number(placement.map(|p| p.mae / si), 3),
            gauge
                .fault
                .as_ref()
                .map_or(String::new(), ToString::to_string),
        ]
    });
    Table {
        caption: "Gauges, the most sensitive to torque first".into(),
        head: head.map(str::to_owned).to_vec(),
        rows: rows.collect(),
    }
}

fn proposed(machine: &Machine, proposals: &[Proposal]) -> Table {
    let names = |proposal: &Proposal, size: usize| {
        let chosen = proposal.order.iter().take(size);
        chosen
            .map(|&i| {
                machine.channels[proposal.candidates[i].channel]
                    .name
                    .as_str()
            })
            .collect::<Vec<_>>()
            .join(", ")
    };
    Table {
        caption: "Proposed gauges".into(),
        head: ["Group", "1", "3", "5"].map(str::to_owned).to_vec(),
        rows: proposals
            .iter()
            .map(|p| vec![p.group.clone(), names(p, 1), names(p, 3), names(p, 5)])
            .collect(),
    }
}

/// Response against error, as figure 7 of the paper.
fn front_plot(machine: &Machine, proposal: &Proposal) -> Plot {
    let mut order: Vec<usize> = (0..proposal.candidates.len()).collect();
    order.sort_by(|a, b| {
        proposal.candidates[*a]
            .response
            .total_cmp(&proposal.candidates[*b].response)
    });
    let front = fronts(&proposal.candidates);
    let (unit, si) = proposal
        .candidates
        .first()
        .map_or((String::new(), 1.0), |c| {
            shown(&machine.channels[c.channel])
        });
    let errors = |holds: &dyn Fn(usize) -> bool| -> Vec<f64> {
        order
            .iter()
            .map(|&i| {
                if holds(i) {
                    proposal.candidates[i].mae / si
                } else {
                    f64::NAN
                }
            })
            .collect()
    };
    let (torque, per_torque) = torque_unit(machine);
    let name = |i: usize| &machine.channels[proposal.candidates[i].channel].name;
    let rank = |i: usize| proposal.order.iter().position(|chosen| *chosen == i);
    let points = |label: &str, role| Series::new(label, role, Mark::Points);
    Plot {
        title: proposal.group.clone(),
        size: PlotSize::Half,
        x: Axis::new("Response |f_T|", &format!("{unit} per {torque}")),
        y: Axis::new("MAE", &unit),
        data: Data::Own {
            x: order
                .iter()
                .map(|&i| per_torque * proposal.candidates[i].response / si)
                .collect(),
            series: vec![
                (points("gauges", Role::Measured), errors(&|_| true)),
                (
                    points("Pareto front", Role::Reference),
                    errors(&|i| front[i] == 0),
                ),
                (
                    points("proposed, 5", Role::Predicted),
                    errors(&|i| rank(i).is_some_and(|r| r < 5)),
                ),
                (
                    points("proposed, 3", Role::Innovation),
                    errors(&|i| rank(i).is_some_and(|r| r < 3)),
                ),
                (
                    points("proposed, 1", Role::Estimate),
                    errors(&|i| rank(i) == Some(0)),
                ),
            ],
        },
        names: order.iter().map(|&i| name(i).clone()).collect(),
        ..Plot::default()
    }
}

/// Degrees in the middle of each bin.
fn degrees() -> Vec<f64> {
    (0..POINTS)
        .map(|i| (i as f64 + 0.5) * 360.0 / POINTS as f64)
        .collect()
}

/// A map at the middle of each bin.
fn coarse(map: &[f64]) -> Vec<f64> {
    let per_point = BINS / POINTS;
    fine(map, 0.0)
        .chunks(per_point)
        .map(|bins| bins.iter().sum::<f64>() / per_point as f64)
        .collect()
}

/// Simulated before and after the update, and measured: what the bins' readings
/// are off the fitted surface is added to the surface at the same torque.
fn compared(
    machine: &Machine,
    observations: &Observations,
    gauge: &Gauge,
    source: MapSource,
) -> Option<Plot> {
    let channel = &machine.channels[gauge.channel];
    let moments = observations.channels[gauge.channel].as_ref()?;
    let (surface, placement) = (gauge.surface.as_ref()?, gauge.placement.as_ref()?);
    let (unit, si) = shown(channel);
    let torque = constant_torque(observations, gauge)?;
    let fitted = coarse(&surface.map);
    let bins = moments.coarse(POINTS);
    let measured = bins.iter().zip(&fitted).map(|(bin, m)| {
        let off = bin.error(surface.offset - moments.origin(), *m) / bin.n;
        (surface.offset + m * torque + off) / si
    });
    let simulated = |offset: f64, map: &[f64]| -> Vec<f64> {
        coarse(map)
            .iter()
            .map(|m| (offset + m * torque) / si)
            .collect()
    };
    let described = channel.sensitivity_over_angle(machine).ok()?;
    let (offset, map) = gauge.model(source)?;
    Some(Plot {
        title: format!(
            "{}: MAE {:.3} {unit}, was {:.3}",
            channel.name,
            placement.mae / si,
            placement.mae_before / si
        ),
        size: PlotSize::Third,
        x: Axis::new("Carrier angle", "°"),
        y: Axis::new("Reading", &unit),
        data: Data::Own {
            x: degrees(),
            series: vec![
                (
                    Series::new("measured", Role::Measured, Mark::Points),
                    measured.collect(),
                ),
                (
                    Series::line("simulated, as described", Role::Other),
                    simulated(channel.to_si(channel.offset), &described),
                ),
                (
                    Series::line("simulated, updated", Role::Predicted),
                    simulated(offset, map),
                ),
            ],
        },
        ..Plot::default()
    })
}

/// The largest mean of what a gauge sensed at one carrier angle.
fn constant_torque(observations: &Observations, gauge: &Gauge) -> Option<f64> {
    let bins = observations.channels[gauge.channel].as_ref()?.coarse(64);
    let means = bins
        .iter()
        .filter(|bin| bin.n > 0.0)
        .map(|bin| bin.s / bin.n);
    means.max_by(|a, b| a.abs().total_cmp(&b.abs()))
}

fn surface_plot(machine: &Machine, observations: &Observations, gauge: &Gauge) -> Option<Plot> {
    let channel = &machine.channels[gauge.channel];
    let surface = gauge.surface.as_ref()?;
    let (unit, si) = shown(channel);
    let torque = constant_torque(observations, gauge)?;
    let map = coarse(&surface.map);
    let cuts = CUTS.iter().map(|cut| {
        let (prefix, factor) = prefix_of(torque);
        let label = format!("{} {prefix}Nm", significant(cut * torque / factor));
        let values = map
            .iter()
            .map(|m| (surface.offset + cut * torque * m) / si)
            .collect();
        (Series::line(&label, Role::Predicted), values)
    });
    Some(Plot {
        title: format!(
            "{}: RMSE {:.3} {unit}, adjusted R² {:.4}",
            channel.name,
            surface.rmse / si,
            surface.adjusted_r2
        ),
        size: PlotSize::Third,
        x: Axis::new("Carrier angle", "°"),
        y: Axis::new("Reading", &unit),
        data: Data::Own {
            x: degrees(),
            series: cuts.collect(),
        },
        ..Plot::default()
    })
}
