//! Gathers the estimates of a replay sample by sample: curves decimated to minima and maxima, and
//! every sample compressed, in the page or a file beside it, in bounded memory. Makes the sections
//! of its page (`ReplayPlots`): loads with 2 σ band, reference and error; NIS with bounds; flags;
//! readings, innovations and their spectra.

use super::{
    Axis, Combination, Data, Limit, Mark, MinMaxDecimator, Plot, Role, Samples, Section, Series,
    Shaded,
};
use crate::innovation_spectra::InnovationSpectra;
use crate::sensor_plots::{SENSOR_COLUMNS, SENSOR_STORED, SensorPlots, flag};
use loadtwin_common::io::estimate::{Estimate, LoadEstimate};
use loadtwin_math::metrics::{NisConsistency, chi_squared_bounds};
use std::path::Path;

/// Buckets over time: with two points each, more than a wide screen has pixels.
const BUCKETS: usize = 4096;

/// Samples that the smoothed NIS looks back on.
const SMOOTHED_SAMPLES: f64 = 200.0;

/// Columns over time for each load.
const LOAD_COLUMNS: usize = 6;

/// Columns over time for the NIS.
const NIS_COLUMNS: usize = 4;

/// Columns of a load of which every sample is stored: value, 2 σ, reference, whether it is not
/// valid.
const LOAD_STORED: usize = 4;

/// How a load is shown.
#[derive(Clone, Debug)]
pub struct LoadLabel {
    /// Heading.
    pub name: String,
    /// Physical quantity, e.g. `Torque`.
    pub quantity: String,
    /// Unit of the estimate, e.g. `N m`.
    pub unit: String,
}

/// How a sensor is shown.
#[derive(Clone, Debug)]
pub struct SensorLabel {
    /// Heading.
    pub name: String,
    /// Physical quantity, e.g. `Strain`.
    pub quantity: String,
    /// Unit on the page, e.g. `µm/m`.
    pub unit: String,
    /// Value in that unit of one unit of the estimator: 1e6 for strain in µm/m.
    pub factor: f64,
    /// Whether it is also shown over the carrier (or shaft) angle.
    pub over_angle: bool,
}

/// Loads, readings, innovations and NIS of one replay, in memory that does not grow with its
/// length.
pub struct ReplayPlots {
    loads: Vec<(LoadLabel, bool)>,
    sensors: Vec<SensorPlots>,
    labels: Vec<SensorLabel>,
    spectra: InnovationSpectra,
    time: MinMaxDecimator,
    row: Vec<f64>,
    samples: Samples,
    nis: NisConsistency,
    smoothed_nis: Option<f64>,
    most_channels: usize,
}

impl ReplayPlots {
    /// Nothing gathered yet, at `rate_hz` samples a second; loads and sensors in the order of
    /// [`Estimate`].
    pub fn new(loads: Vec<LoadLabel>, sensors: Vec<SensorLabel>, rate_hz: f64) -> Self {
        let columns = LOAD_COLUMNS * loads.len() + SENSOR_COLUMNS * sensors.len() + NIS_COLUMNS;
        let samples = samples_of(loads.len(), sensors.len());
        let names = loads.iter().map(|load| load.name.as_str());
        Self {
            spectra: InnovationSpectra::new(names, sensors.len(), rate_hz),
            loads: loads.into_iter().map(|load| (load, false)).collect(),
            sensors: sensors.iter().cloned().map(SensorPlots::new).collect(),
            labels: sensors,
            time: MinMaxDecimator::new(columns, BUCKETS),
            row: Vec::with_capacity(columns),
            samples,
            nis: NisConsistency::default(),
            smoothed_nis: None,
            most_channels: 0,
        }
    }

    /// Adds the estimate at `t_s` (s), not before the last.
    ///
    /// `references`: one for each load, in its unit, NaN where there is none; may be shorter. A
    /// load that is not valid and a sensor that was not read leave a gap; a sensor that is flagged
    /// is shown, but takes no part in autocorrelation, distribution and NIS.
    pub fn push(&mut self, t_s: f64, references: &[f64], estimate: &Estimate) {
        self.row.clear();
        for (i, (_, has_reference)) in self.loads.iter_mut().enumerate() {
            let load = estimate.loads.get(i).copied().unwrap_or(LoadEstimate {
                value: f32::NAN,
                ..LoadEstimate::default()
            });
            let value = if load.fault.is_none() {
                f64::from(load.value)
            } else {
                f64::NAN
            };
            let deviation = 2.0 * f64::from(load.std);
            let reference = references.get(i).copied().unwrap_or(f64::NAN);
            *has_reference |= reference.is_finite();
            let (upper, lower) = (value + deviation, value - deviation);
            let not_valid = flag(load.fault);
            self.row
                .extend([value, upper, lower, reference, value - reference, not_valid]);
        }
        let (mut nis, mut channels) = (0.0, 0);
        let degrees = f64::from(estimate.angle_rad).to_degrees().rem_euclid(360.0);
        let angle = if estimate.homed { degrees } else { f64::NAN };
        for (i, sensor) in self.sensors.iter_mut().enumerate() {
            let read = estimate.sensors.get(i).copied();
            if let Some(used) = read.filter(|s| s.fault.is_none() && s.innovation_variance > 0.0) {
                nis += f64::from(used.nis);
                channels += 1;
            }
            self.row.extend(sensor.push(angle, read));
        }
        self.spectra.push(&self.labels, references, estimate);
        self.nis.push(nis, channels);
        self.most_channels = self.most_channels.max(channels);
        let nis = if channels > 0 { nis } else { f64::NAN };
        if nis.is_finite() {
            let smoothed = self.smoothed_nis.get_or_insert(nis);
            *smoothed += (nis - *smoothed) / SMOOTHED_SAMPLES;
        }
        let smoothed = self.smoothed_nis.unwrap_or(f64::NAN);
        let flagged = estimate
            .sensors
            .iter()
            .filter(|s| !s.fault.is_none())
            .count();
        let not_valid = estimate.loads.iter().filter(|l| !l.fault.is_none()).count();
        let counts = [flagged, not_valid].map(|count| count as f64);
        self.row.extend([nis, smoothed, counts[0], counts[1]]);
        self.time.push(t_s, &self.row);
        self.samples.push(t_s, stored(&self.row, self.loads.len()));
    }

    /// Writes every sample to the file beside `page`, instead of into the page; before the first
    /// sample.
    pub fn write_samples_beside(&mut self, page: &Path) {
        self.samples.write_beside(page);
    }

    /// NIS of all sensors in use, gathered so far.
    pub fn nis(&self) -> &NisConsistency {
        &self.nis
    }

    /// What goes into [`super::Report::time`], [`super::Report::samples`] and
    /// [`super::Report::sections`].
    pub fn finish(mut self) -> (MinMaxDecimator, Samples, Vec<Section>) {
        self.samples.end();
        let first_sensor = LOAD_COLUMNS * self.loads.len();
        let first_nis = first_sensor + SENSOR_COLUMNS * self.sensors.len();
        let loads = self
            .loads
            .iter()
            .enumerate()
            .flat_map(|(i, (label, known))| load_plots(label, *known, LOAD_COLUMNS * i))
            .collect();
        let sensors = || (first_sensor..).step_by(SENSOR_COLUMNS).zip(&self.sensors);
        let readings = sensors()
            .flat_map(|(column, s)| s.reading_plots(column))
            .collect();
        let innovations = (sensors().zip(&self.labels).enumerate())
            .flat_map(|(i, ((column, sensor), label))| {
                let mut plots = sensor.innovation_plots(column).to_vec();
                plots.extend(self.spectra.plots(i, label));
                plots
            })
            .collect();
        let section = |title: &str, note: &str, open, plots| Section {
            title: title.to_owned(),
            note: note.to_owned(),
            open,
            tables: Vec::new(),
            plots,
        };
        let sections = vec![
            section("Loads", "", true, loads),
            section(
                "Consistency",
                "The NIS of a consistent filter is outside the bounds in 5 % of the samples.",
                true,
                vec![
                    nis_plot(first_nis, self.most_channels),
                    flags_plot(first_nis + 2),
                ],
            ),
            section(
                "Sensors",
                "Measured, and predicted by the model before the sample was used.",
                false,
                readings,
            ),
            section(
                "Innovations",
                "Of a complete model they are white and normal: no more than one lag in a hundred of the \
                 autocorrelation is outside the bounds, and one value in twenty of the spectrum and of the \
                 correlation with earlier speeds and estimates. Coherence is with speed and reference loads.",
                false,
                innovations,
            ),
        ];
        (self.time, self.samples, sections)
    }
}

/// The stored columns of a row over time, and nothing that follows from them.
fn stored(row: &[f64], loads: usize) -> impl Iterator<Item = f64> {
    let (loads, others) = row.split_at(LOAD_COLUMNS * loads);
    let (sensors, nis) = others.split_at(others.len() - NIS_COLUMNS);
    let of_load = |load: &[f64]| [load[0], load[1] - load[0], load[3], load[5]];
    let of_sensor = |sensor: &[f64]| [sensor[0], sensor[2], sensor[3]];
    (loads.chunks_exact(LOAD_COLUMNS).flat_map(of_load))
        .chain(sensors.chunks_exact(SENSOR_COLUMNS).flat_map(of_sensor))
        .chain(nis.iter().copied())
}

/// Samples of the columns that [`stored`] gives, and the columns over time as their sums.
fn samples_of(loads: usize, sensors: usize) -> Samples {
    let mut columns: Vec<Combination> = Vec::new();
    for value in (0..loads).map(|load| LOAD_STORED * load) {
        let [deviation, reference, not_valid] = [1, 2, 3].map(|i| value + i);
        columns.extend([
            vec![(value, 1.0)],
            vec![(value, 1.0), (deviation, 1.0)],
            vec![(value, 1.0), (deviation, -1.0)],
            vec![(reference, 1.0)],
            vec![(value, 1.0), (reference, -1.0)],
            vec![(not_valid, 1.0)],
        ]);
    }
    let first = LOAD_STORED * loads;
    for measured in (0..sensors).map(|sensor| first + SENSOR_STORED * sensor) {
        columns.extend([
            vec![(measured, 1.0)],
            vec![(measured, 1.0), (measured + 1, -1.0)],
            vec![(measured + 1, 1.0)],
            vec![(measured + 2, 1.0)],
        ]);
    }
    let first = first + SENSOR_STORED * sensors;
    columns.extend((first..first + NIS_COLUMNS).map(|nis| vec![(nis, 1.0)]));
    Samples::new(first + NIS_COLUMNS, columns)
}

fn load_plots(label: &LoadLabel, known: bool, column: usize) -> Vec<Plot> {
    let mut series = vec![
        (Series::line("estimate", Role::Estimate), column),
        (
            Series::new("± 2 σ", Role::Estimate, Mark::Upper),
            column + 1,
        ),
        (
            Series::new("- 2 σ", Role::Estimate, Mark::Lower),
            column + 2,
        ),
    ];
    let shaded = Some(Shaded::new("not valid", column + 5));
    let band = Some([column + 1, column + 2]);
    let mut plots = Vec::new();
    if known {
        series.push((Series::line("reference", Role::Reference), column + 3));
        plots.push(Plot {
            title: format!("{}, error", label.name),
            y: Axis::new("Estimate - reference", &label.unit),
            data: Data::Time(vec![(Series::line("error", Role::Other), column + 4)]),
            shaded: shaded.clone(),
            band,
            ..Plot::default()
        });
    }
    let load = Plot {
        title: label.name.clone(),
        y: Axis::new(&label.quantity, &label.unit),
        data: Data::Time(series),
        shaded,
        band,
        ..Plot::default()
    };
    plots.insert(0, load);
    plots
}

fn nis_plot(column: usize, channels: usize) -> Plot {
    let limits = ["2.5 %", "97.5 %"]
        .into_iter()
        .zip(chi_squared_bounds(0.95, channels as f64))
        .filter(|(_, value)| value.is_finite())
        .map(|(label, value)| Limit {
            label: label.to_owned(),
            value,
        });
    Plot {
        title: format!("Normalised innovation squared, {channels} expected"),
        y: Axis {
            logarithmic: true,
            ..Axis::new("NIS", "")
        },
        data: Data::Time(vec![
            (Series::line("NIS", Role::Innovation), column),
            (Series::line("smoothed", Role::Other), column + 1),
        ]),
        limits: limits.collect(),
        ..Plot::default()
    }
}

fn flags_plot(column: usize) -> Plot {
    Plot {
        title: "Flags".into(),
        y: Axis::new("Number", ""),
        data: Data::Time(vec![
            (Series::line("sensors flagged", Role::Other), column),
            (
                Series::line("loads not valid", Role::Innovation),
                column + 1,
            ),
        ]),
        ..Plot::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Report;
    use loadtwin_common::io::estimate::SensorEstimate;
    use loadtwin_common::io::fault::Fault;

    fn labels() -> (Vec<LoadLabel>, Vec<SensorLabel>) {
        let load = LoadLabel {
            name: "main shaft".into(),
            quantity: "Torque".into(),
            unit: "N m".into(),
        };
        let sensor = SensorLabel {
            name: "TA1".into(),
            quantity: "Strain".into(),
            unit: "µm/m".into(),
            factor: 1e6,
            over_angle: true,
        };
        (vec![load], vec![sensor; 2])
    }

    fn estimate(faults: [Fault; 2]) -> Estimate {
        Estimate {
            loads: [LoadEstimate {
                value: 100.0,
                std: 3.0,
                ..LoadEstimate::default()
            }]
            .into_iter()
            .collect(),
            sensors: faults
                .map(|fault| SensorEstimate {
                    measured: 50e-6,
                    innovation: 2e-6,
                    innovation_variance: 4e-12,
                    nis: 1.0,
                    fault,
                })
                .into_iter()
                .collect(),
            homed: true,
            ..Estimate::default()
        }
    }

    #[test]
    fn rows_hold_what_the_estimator_said() {
        let (loads, sensors) = labels();
        let mut plots = ReplayPlots::new(loads, sensors, 10.0);
        plots.push(0.0, &[90.0], &estimate([Fault::None, Fault::Erratic]));
        plots.push(0.1, &[], &estimate([Fault::None, Fault::Missing]));
        plots.push(0.2, &[], &Estimate::default());
        assert_eq!((plots.nis().samples(), plots.nis().mean()), (2, Some(1.0)));
        let (time, _, sections) = plots.finish();
        let rows = time.rows();
        let near = |column: usize, expected: [f32; 3]| {
            for (found, e) in rows.columns[column].iter().zip(expected) {
                let same = (found - e).abs() < 1e-3 || (found.is_nan() && e.is_nan());
                assert!(
                    same,
                    "column {column}: {:?}, {expected:?}",
                    rows.columns[column]
                );
            }
        };
        let gap = f32::NAN;
        near(0, [100.0, 100.0, gap]);
        near(1, [106.0, 106.0, gap]);
        near(2, [94.0, 94.0, gap]);
        near(3, [90.0, gap, gap]);
        near(4, [10.0, gap, gap]);
        near(5, [0.0, 0.0, 0.0]);
        near(6, [50.0, 50.0, gap]);
        near(7, [48.0, 48.0, gap]);
        near(9, [0.0, 0.0, gap]);
        near(10, [50.0, gap, gap]);
        near(13, [1.0, 1.0, gap]);
        near(14, [1.0, 1.0, gap]);
        let counts: Vec<_> = sections.iter().map(|s| s.plots.len()).collect();
        assert_eq!(counts, [2, 2, 4, 6]);
        // One channel in use at most: 0.001 and 5.02.
        let limits = &sections[1].plots[0].limits;
        assert!((limits[1].value - 5.024).abs() < 1e-3, "{limits:?}");
        let report = Report {
            time: Some(time),
            sections,
            ..Report::default()
        };
        assert!(report.to_html().is_ok());
    }

    #[test]
    fn a_load_that_is_not_valid_is_a_gap() {
        let (loads, sensors) = labels();
        let mut plots = ReplayPlots::new(loads, sensors, 10.0);
        let mut not_valid = estimate([Fault::None, Fault::Stuck]);
        not_valid.loads[0] = LoadEstimate {
            value: 0.0,
            fault: Fault::NotValid,
            ..not_valid.loads[0]
        };
        plots.push(0.0, &[90.0], &not_valid);
        let (time, ..) = plots.finish();
        let columns = time.rows().columns;
        for gap in [0, 1, 2, 4] {
            assert!(columns[gap][0].is_nan(), "{gap}: {:?}", columns[gap]);
        }
        assert_eq!((columns[3][0], columns[5][0]), (90.0, 1.0));
        // What a sensor that is flagged read is shown.
        assert_eq!((columns[10][0], columns[13][0]), (50.0, 1.0));
        let flags = columns.len() - 2;
        assert_eq!([columns[flags][0], columns[flags + 1][0]], [1.0, 1.0]);
    }

    /// No reference, no angle, no sensor: only what there is.
    #[test]
    fn what_is_not_there_is_not_plotted() {
        let (loads, mut sensors) = labels();
        sensors.truncate(1);
        let mut plots = ReplayPlots::new(loads, sensors, 10.0);
        let unhomed = Estimate {
            homed: false,
            ..estimate([Fault::None; 2])
        };
        plots.push(0.0, &[f64::NAN], &unhomed);
        let (.., sections) = plots.finish();
        let counts: Vec<_> = sections.iter().map(|s| s.plots.len()).collect();
        assert_eq!(counts, [1, 2, 1, 3]);
    }
}
