//! Builds the report page of a replay from samples, estimates and figures: key figures, tables of
//! errors and sensors, plots of estimates, references and sensors, orbits of a rotor.

use std::collections::BTreeMap;
use std::path::Path;

use loadtwin_common::io::estimate::Estimate;

use super::{Consistency, Displacements, Figures, Phasor, Sample};
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::{Machine, Senses};
use loadtwin_recording::Quantity;
use loadtwin_report::{KeyFigure, LoadLabel, ReplayPlots, Report, SensorLabel, Table};

/// Gathers a replay's report in memory that does not grow with its length.
pub struct ReportPage {
    plots: ReplayPlots,
    /// For each load, the reference that measures it.
    reference_of: Vec<Option<usize>>,
    references: Vec<f64>,
}

impl ReportPage {
    /// Nothing gathered yet.
    pub fn new(machine: &Machine, sensors: &Sensors) -> Self {
        let loads = machine.loads();
        let reference_of: Vec<_> = loads
            .iter()
            .map(|load| machine.references.iter().position(|r| r.load == load.name))
            .collect();
        let load_labels = loads
            .iter()
            .map(|load| LoadLabel {
                name: load.name.to_owned(),
                quantity: capitalised(&load.unit.quantity().to_string()),
                unit: load.unit.to_string(),
            })
            .collect();
        let channels = sensors.channels.iter().map(|channel| {
            let si = channel.unit.si();
            let shown = if si.quantity() == Quantity::Strain {
                "µm/m".parse().unwrap_or(si)
            } else {
                si
            };
            SensorLabel {
                name: channel.name.clone(),
                quantity: capitalised(&si.quantity().to_string()),
                unit: shown.to_string(),
                factor: shown.from_si(1.0),
                over_angle: matches!(channel.senses, Senses::Shaft(_)),
            }
        });
        let encoders = sensors.encoders.iter().map(|encoder| SensorLabel {
            name: encoder.name.clone(),
            quantity: "Angle".into(),
            unit: "rad".into(),
            factor: 1.0,
            over_angle: false,
        });
        Self {
            references: vec![f64::NAN; reference_of.len()],
            plots: ReplayPlots::new(
                load_labels,
                channels.chain(encoders).collect(),
                machine.rate_hz,
            ),
            reference_of,
        }
    }

    /// Writes every sample to a file beside `page`, instead of into the page; before the first sample.
    pub fn write_samples_beside(&mut self, page: &Path) {
        self.plots.write_samples_beside(page);
    }

    /// Adds one sample and its estimate.
    pub fn push(&mut self, sample: &Sample<'_>, estimate: &Estimate) {
        for (slot, column) in self.references.iter_mut().zip(&self.reference_of) {
            *slot = column
                .and_then(|i| sample.references.get(i))
                .copied()
                .unwrap_or(f64::NAN);
        }
        self.plots.push(sample.t, &self.references, estimate);
    }

    /// The page, with the error tables of `figures` and of the baseline, what the sensors agree on,
    /// and the orbits of a rotor.
    pub fn finish(
        self,
        machine: &Machine,
        (sensors, recording): (&Sensors, &str),
        (figures, consistency): (&Figures, &Consistency),
        displacements: &Displacements,
        phasor: &Phasor,
    ) -> Report {
        let (time, samples, mut sections) = self.plots.finish();
        sections.extend(displacements.sections());
        let mut tables = vec![error_table(machine, figures)];
        tables.extend(baseline_table(machine, phasor));
        tables.push(sensor_table(consistency));
        Report {
            title: machine.name.clone(),
            facts: (consistency.note().into_iter())
                .map(|note| ["Disagreement".into(), note])
                .chain([
                    ["Recording".into(), recording.into()],
                    ["Sensors".into(), sensors.name.clone()],
                    [
                        "Samples".into(),
                        format!("{} at {} Hz", figures.samples(), machine.rate_hz),
                    ],
                ])
                .collect(),
            key_figures: key_figures(figures),
            tables,
            time: Some(time),
            samples: Some(samples),
            sections,
        }
    }
}

fn key_figures(figures: &Figures) -> Vec<KeyFigure> {
    let mut key_figures: Vec<KeyFigure> = figures
        .loads()
        .filter_map(|(name, load)| {
            let nmae = load.nmae_percent.get("full").copied().flatten()?;
            Some(KeyFigure {
                label: format!("NMAE {name}"),
                value: format!("{nmae:.2} %"),
                note: format!(
                    "mean absolute error over the nominal load; valid in {} % of the time",
                    cell(load.valid_percent)
                ),
            })
        })
        .collect();
    for (name, load) in figures.loads() {
        if let Some(band) = load.band {
            let [one, two, three] = band.inside_percent;
            key_figures.push(KeyFigure {
                label: format!("inside 2 σ {name}"),
                value: format!("{two:.1} %"),
                note: format!(
                    "inside 1 and 3 σ: {one:.1} and {three:.1} %, error over σ {:.2}; normal: 95.4, 68.3 and 99.7 %, 1",
                    band.error_over_sigma
                ),
            });
        }
    }
    if let Some(next) = figures.largest_next() {
        key_figures.push(KeyFigure {
            label: "innovations, one sample to the next".into(),
            value: format!("{next:.2}"),
            note: "largest autocorrelation of a sensor; 0 in a consistent filter".into(),
        });
    }
    if let Some(nis) = figures.nis_mean() {
        key_figures.push(KeyFigure {
            label: "mean NIS".into(),
            value: format!("{nis:.2}"),
            note: "1 in a consistent filter".into(),
        });
    }
    key_figures
}

/// Consistency and flags of each sensor.
fn sensor_table(consistency: &Consistency) -> Table {
    let rows = consistency.sensors.iter().map(|sensor| {
        vec![
            sensor.name.clone(),
            cell(sensor.contradicting_percent),
            cell(sensor.nis),
            cell(sensor.bias),
            listed(&sensor.flags),
        ]
    });
    Table {
        caption: "Sensors: readings that contradict the model (0.27 % in a consistent filter), flagged samples"
            .into(),
        head: ["Sensor", "contradicting [%]", "NIS", "mean [σ]", "flagged"].map(String::from).to_vec(),
        rows: rows.collect(),
    }
}

fn error_table(machine: &Machine, figures: &Figures) -> Table {
    let segments = machine.segments.iter().map(|s| s.name.clone());
    let mut columns = vec!["Load".to_owned(), "full".to_owned()];
    columns.extend(segments.clone());
    let last = [
        "RMSE",
        "bias",
        "largest",
        "valid [% of the time]",
        "flagged",
    ];
    columns.extend(last.map(String::from));
    let rows = figures
        .loads()
        .map(|(name, load)| {
            let nmae = |key: &str| cell(load.nmae_percent.get(key).copied().flatten());
            let mut row = vec![name.to_owned(), nmae("full")];
            row.extend(segments.clone().map(|segment| nmae(&segment)));
            row.extend([
                cell(load.rmse_percent),
                cell(load.bias_percent),
                cell(load.largest_error_percent),
                cell(load.valid_percent),
                listed(&load.flags),
            ]);
            row
        })
        .collect();
    Table {
        caption:
            "Error [% of the nominal load]: NMAE of all and of parts; largest of valid samples"
                .into(),
        head: columns,
        rows,
    }
}

/// The 1x phasor inversion beside the filter; none on machines that are no rotor.
fn baseline_table(machine: &Machine, phasor: &Phasor) -> Option<Table> {
    let parts: Vec<&str> = std::iter::once("full")
        .chain(machine.segments.iter().map(|s| s.name.as_str()))
        .collect();
    let rows: Vec<Vec<String>> = (phasor.figures().into_iter())
        .map(|(name, load)| {
            let of = |part: &&str| cell(load.nmae_percent.get(*part).copied().flatten());
            std::iter::once(name).chain(parts.iter().map(of)).collect()
        })
        .filter(|row: &Vec<String>| row[1..].iter().any(|cell| cell != "–"))
        .collect();
    (!rows.is_empty()).then(|| Table {
        caption: "Error of the 1x phasor inversion [% of the nominal load]".into(),
        head: std::iter::once("Load")
            .chain(parts)
            .map(String::from)
            .collect(),
        rows,
    })
}

fn listed(flags: &BTreeMap<&'static str, u64>) -> String {
    let flags = flags
        .iter()
        .map(|(fault, count)| format!("{fault}: {count}"));
    flags.collect::<Vec<_>>().join(", ")
}

fn cell(value: Option<f64>) -> String {
    value.map_or_else(
        || "–".into(),
        |value| {
            // Without the sign of what is rounded to 0.
            format!("{:.2}", (100.0 * value).round() / 100.0 + 0.0)
        },
    )
}

fn capitalised(word: &str) -> String {
    let mut letters = word.chars();
    letters.next().map_or_else(String::new, |first| {
        first.to_uppercase().chain(letters).collect()
    })
}
