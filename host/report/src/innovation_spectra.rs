//! Plots the innovations of one sensor over frequency for the page of a replay: spectral density
//! with bounds of white noise, coherence with speed and reference loads, cross-correlation with
//! earlier speeds and load estimates. Gathered sample by sample (`InnovationSpectra`).
//!
//! An estimate is made from the innovations, so that its coherence with them is 1 in every filter;
//! with what was measured before, the innovations of a consistent filter are not correlated.

use std::f64::consts::{PI, TAU};

use loadtwin_common::io::estimate::{Estimate, SensorEstimate};
use loadtwin_math::metrics::{CrossCorrelation, LAGS, Spectra};

use crate::{Axis, Data, Limit, Plot, PlotSize, Role, SensorLabel, Series};

/// Inputs at most: further ones have no colour of their own in a plot.
const MOST_INPUTS: usize = 6;

/// Spectra and cross-correlations of all sensors, gathered so far.
pub(crate) struct InnovationSpectra {
    /// Speed, then loads.
    inputs: Vec<String>,
    rate_hz: f64,
    /// Angle (rad) of the sample before, and whether it was homed.
    last: Option<(f64, bool)>,
    spectra: Spectra,
    /// Sensor by sensor, of each input.
    crossed: Vec<CrossCorrelation>,
    /// Innovations, then speed and reference loads, of the present sample.
    row: Vec<f64>,
}

impl InnovationSpectra {
    /// Nothing gathered yet.
    pub(crate) fn new<'a>(
        loads: impl Iterator<Item = &'a str>,
        sensors: usize,
        rate_hz: f64,
    ) -> Self {
        let inputs: Vec<String> = std::iter::once("speed")
            .chain(loads)
            .take(MOST_INPUTS)
            .map(str::to_owned)
            .collect();
        Self {
            rate_hz,
            last: None,
            spectra: Spectra::new(sensors, inputs.len(), rate_hz),
            crossed: vec![CrossCorrelation::default(); sensors * inputs.len()],
            row: Vec::with_capacity(sensors + inputs.len()),
            inputs,
        }
    }

    /// Gathers one sample of these sensors.
    ///
    /// `references`: one for each load, NaN where there is none; may be shorter.
    pub(crate) fn push(
        &mut self,
        sensors: &[SensorLabel],
        references: &[f64],
        estimate: &Estimate,
    ) {
        self.row.clear();
        let innovation = |(i, label): (usize, &SensorLabel)| {
            let used = |s: &&SensorEstimate| s.fault.is_none() && s.innovation_variance > 0.0;
            let sensor = estimate.sensors.get(i).filter(used);
            sensor.map_or(f64::NAN, |s| f64::from(s.innovation) * label.factor)
        };
        self.row.extend(sensors.iter().enumerate().map(innovation));
        let now = (f64::from(estimate.angle_rad), estimate.homed);
        let speed = match self.last.replace(now) {
            Some((angle, homed)) if homed == now.1 && estimate.lost == 0 => {
                ((now.0 - angle + PI).rem_euclid(TAU) - PI) * self.rate_hz
            }
            _ => f64::NAN,
        };
        self.row.push(speed);
        let loads = 0..self.inputs.len() - 1;
        let reference = |i: usize| references.get(i).copied().unwrap_or(f64::NAN);
        self.row.extend(loads.clone().map(reference));
        let estimated = |i: usize| {
            let load = estimate.loads.get(i).filter(|load| load.fault.is_none());
            load.map_or(f64::NAN, |load| f64::from(load.value))
        };
        let mut crossed = self.crossed.iter_mut();
        for innovation in &self.row[..sensors.len()] {
            for input in std::iter::once(speed).chain(loads.clone().map(estimated)) {
                if let Some(crossed) = crossed.next() {
                    crossed.push(*innovation, input);
                }
            }
        }
        self.spectra.push(self.row.iter().copied());
    }

    /// The plots of sensor `i`; none of a recording shorter than two segments.
    pub(crate) fn plots(&self, i: usize, label: &SensorLabel) -> Vec<Plot> {
        [
            self.density_plot(i, label),
            self.coherence_plot(i, label),
            self.cross_correlation_plot(i, label),
        ]
        .into_iter()
        .flatten()
        .collect()
    }

    fn density_plot(&self, i: usize, label: &SensorLabel) -> Option<Plot> {
        let density = self.spectra.density(i)?;
        let limits = ["2.5 %", "97.5 %"].into_iter().zip(density.white);
        // Of a sequence without variance there is nothing to draw on a logarithmic axis.
        let is_positive = density.white[0] > 0.0;
        is_positive.then(|| Plot {
            title: format!("{}, spectrum", label.name),
            size: PlotSize::Third,
            x: Axis::new("Frequency", "Hz"),
            y: Axis {
                logarithmic: true,
                ..Axis::new("Spectral density", &squared_per_hertz(&label.unit))
            },
            limits: limits.map(|(text, value)| limit(text, value)).collect(),
            data: Data::Own {
                x: self.spectra.frequencies_hz(),
                series: vec![(Series::line("innovation", Role::Innovation), density.values)],
            },
            ..Plot::default()
        })
    }

    fn coherence_plot(&self, i: usize, label: &SensorLabel) -> Option<Plot> {
        let found: Vec<_> = (self.inputs.iter().enumerate())
            .filter_map(|(k, name)| Some((name, self.spectra.coherence(i, k)?)))
            .collect();
        // The input with the fewest segments has the highest bound.
        let bound = (found.iter().map(|(_, c)| c.bound)).reduce(f64::max)?;
        let series = found.into_iter().enumerate();
        Some(Plot {
            title: format!("{}, coherence", label.name),
            size: PlotSize::Third,
            x: Axis::new("Frequency", "Hz"),
            y: Axis::new("Coherence", ""),
            limits: vec![limit("95 %", bound)],
            data: Data::Own {
                x: self.spectra.frequencies_hz(),
                series: series
                    .map(|(k, (name, c))| (of_input(k, name), c.values))
                    .collect(),
            },
            ..Plot::default()
        })
    }

    fn cross_correlation_plot(&self, i: usize, label: &SensorLabel) -> Option<Plot> {
        let of_sensor = &self.crossed[i * self.inputs.len()..];
        let found: Vec<_> = (self.inputs.iter().zip(of_sensor))
            .filter(|(_, crossed)| crossed.coefficients().iter().any(Option::is_some))
            .collect();
        let bound = (found.iter().map(|(_, c)| c.bound())).reduce(f64::max)?;
        let series = found.into_iter().enumerate();
        let values = |crossed: &CrossCorrelation| {
            let all = crossed.coefficients();
            all.map(|r| r.unwrap_or(f64::NAN)).to_vec()
        };
        Some(Plot {
            title: format!("{}, correlation with earlier", label.name),
            size: PlotSize::Third,
            x: Axis::new("Lag", "samples"),
            y: Axis::new("Cross-correlation", ""),
            limits: vec![limit("95 %", bound), limit("95 %", -bound)],
            data: Data::Own {
                x: (1..=LAGS).map(|lag| lag as f64).collect(),
                series: series
                    .map(|(k, (name, c))| (of_input(k, name), values(c)))
                    .collect(),
            },
            ..Plot::default()
        })
    }
}

/// Inputs have colours in their order.
fn of_input(k: usize, name: &str) -> Series {
    let role = [Role::Other, Role::Estimate, Role::Measured][k.min(2)];
    Series::line(name, role)
}

fn limit(label: &str, value: f64) -> Limit {
    Limit {
        label: label.to_owned(),
        value,
    }
}

/// `rad²/Hz`, `(µm/m)²/Hz`.
fn squared_per_hertz(unit: &str) -> String {
    if unit.contains(['/', ' ']) {
        format!("({unit})²/Hz")
    } else {
        format!("{unit}²/Hz")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use loadtwin_common::io::estimate::LoadEstimate;

    /// Innovations at 100 Hz, and speed that varies with them; an estimate that is constant, and a
    /// reference that rises.
    #[test]
    fn a_line_is_in_spectrum_and_coherence_and_a_constant_is_no_input() {
        let label = SensorLabel {
            name: "TA1".into(),
            quantity: "Strain".into(),
            unit: "µm/m".into(),
            factor: 1e6,
            over_angle: true,
        };
        let mut spectra = InnovationSpectra::new(["shaft"].into_iter(), 1, 1000.0);
        let mut angle = 0.0;
        for i in 0..8000 {
            let wave = (TAU * 0.1 * f64::from(i)).sin();
            angle += 0.02 + 0.001 * wave;
            let sensor = SensorEstimate {
                innovation: (2e-6 * wave) as f32,
                innovation_variance: 1e-12,
                ..SensorEstimate::default()
            };
            let estimate = Estimate {
                angle_rad: ((angle + PI).rem_euclid(TAU) - PI) as f32,
                loads: std::iter::once(LoadEstimate {
                    value: 5.0,
                    ..LoadEstimate::default()
                })
                .collect(),
                sensors: std::iter::once(sensor).collect(),
                ..Estimate::default()
            };
            spectra.push(
                std::slice::from_ref(&label),
                &[f64::from(i), 0.0],
                &estimate,
            );
        }
        let plots = spectra.plots(0, &label);
        let [density, coherence, crossed] = &plots[..] else {
            panic!("{} plots", plots.len());
        };
        assert_eq!(density.y.unit, "(µm/m)²/Hz");
        let curves = |plot: &Plot| match &plot.data {
            Data::Own { x, series } => (x.clone(), series.clone()),
            Data::Time(_) => panic!("over time"),
        };
        let (f, series) = curves(density);
        let power: f64 = series[0].1.iter().sum::<f64>() * (f[1] - f[0]);
        // (2 µm/m)^2 / 2.
        assert!((power - 2.0).abs() < 0.01, "{power}");
        let top = (0..f.len()).max_by(|a, b| series[0].1[*a].total_cmp(&series[0].1[*b]));
        assert!((f[top.unwrap()] - 100.0).abs() < 1.0);
        let (_, series) = curves(coherence);
        let names: Vec<&str> = series.iter().map(|(s, _)| s.label.as_str()).collect();
        assert_eq!(names, ["speed", "shaft"]);
        assert!(series[0].1[top.unwrap()] > 0.99);
        // Ten samples are a period: 1 at lag 10, -1 at lag 5.
        let (_, series) = curves(crossed);
        assert!(
            series[0].1[9] > 0.99 && series[0].1[4] < -0.99,
            "{:?}",
            series[0].1
        );
        assert_eq!(series.len(), 1);
    }
}
