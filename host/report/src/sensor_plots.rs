//! Gathers the readings of one sensor in a replay, and makes its plots (`SensorPlots`): measured
//! and predicted reading over time and over the shaft angle, innovation, autocorrelation,
//! distribution of the normalised innovation.

use crate::replay_plots::SensorLabel;
use crate::{
    Axis, Data, Mark, Plot, PlotSize, Role, ScatterSample, Series, Shaded, autocorrelation_plot,
    normalised_histogram_plot,
};
use loadtwin_common::io::estimate::SensorEstimate;
use loadtwin_common::io::fault::Fault;
use loadtwin_math::metrics::{Autocorrelation, Histogram};

/// Points of a scatter plot: enough for a shape, few enough to distinguish them.
const POINTS: usize = 2000;

/// Columns over time of a sensor: measured, predicted, innovation, whether it is flagged.
pub(crate) const SENSOR_COLUMNS: usize = 4;

/// Columns of these of which every sample is stored: the prediction follows.
pub(crate) const SENSOR_STORED: usize = SENSOR_COLUMNS - 1;

/// Readings and statistics of one sensor, gathered so far.
pub(crate) struct SensorPlots {
    label: SensorLabel,
    over_angle: ScatterSample,
    acf: Autocorrelation,
    histogram: Histogram,
}

impl SensorPlots {
    /// Nothing gathered yet.
    pub(crate) fn new(label: SensorLabel) -> Self {
        Self {
            label,
            over_angle: ScatterSample::new(POINTS),
            acf: Autocorrelation::default(),
            histogram: Histogram::new(-5.0, 5.0, 50),
        }
    }

    /// Gathers one reading; measured, predicted, innovation and whether it is flagged for the row.
    pub(crate) fn push(
        &mut self,
        angle: f64,
        read: Option<SensorEstimate>,
    ) -> [f64; SENSOR_COLUMNS] {
        let Some(sensor) = read else {
            self.acf.push(f64::NAN);
            return [f64::NAN; SENSOR_COLUMNS];
        };
        let flagged = flag(sensor.fault);
        let normalised = innovation_over_sigma(&sensor);
        self.acf
            .push(normalised.map_or(f64::NAN, |_| f64::from(sensor.innovation)));
        if let Some(normalised) = normalised {
            self.histogram.push(normalised);
        }
        if sensor.fault == Fault::Missing {
            return [f64::NAN, f64::NAN, f64::NAN, flagged];
        }
        let measured = f64::from(sensor.measured) * self.label.factor;
        // Of a reading that is not compared there is no prediction.
        let innovation = if sensor.innovation_variance > 0.0 {
            f64::from(sensor.innovation) * self.label.factor
        } else {
            f64::NAN
        };
        let predicted = measured - innovation;
        if self.label.over_angle && matches!(sensor.fault, Fault::None | Fault::Erratic) {
            self.over_angle.push(&[angle, measured, predicted]);
        }
        [measured, predicted, innovation, flagged]
    }

    pub(crate) fn reading_plots(&self, column: usize) -> Vec<Plot> {
        let label = &self.label;
        let over_time = Plot {
            title: label.name.clone(),
            size: PlotSize::Half,
            y: Axis::new(&label.quantity, &label.unit),
            data: Data::Time(vec![
                (Series::line("predicted", Role::Predicted), column + 1),
                (Series::line("measured", Role::Measured), column),
            ]),
            shaded: Some(Shaded::new("flagged", column + 3)),
            ..Plot::default()
        };
        let mut columns = self.over_angle.columns().into_iter();
        let (Some(x), Some(measured), Some(predicted)) =
            (columns.next(), columns.next(), columns.next())
        else {
            return vec![over_time];
        };
        let points = |label: &str, role| Series::new(label, role, Mark::Points);
        let over_angle = Plot {
            title: format!("{}, over the angle", label.name),
            x: Axis::new("Angle", "°"),
            data: Data::Own {
                x,
                series: vec![
                    (points("predicted", Role::Predicted), predicted),
                    (points("measured", Role::Measured), measured),
                ],
            },
            shaded: None,
            ..over_time.clone()
        };
        vec![over_time, over_angle]
    }

    pub(crate) fn innovation_plots(&self, column: usize) -> [Plot; 3] {
        let name = &self.label.name;
        [
            Plot {
                title: format!("{name}, innovation"),
                size: PlotSize::Third,
                y: Axis::new("Innovation", &self.label.unit),
                data: Data::Time(vec![(
                    Series::line("innovation", Role::Innovation),
                    column + 2,
                )]),
                shaded: Some(Shaded::new("flagged", column + 3)),
                ..Plot::default()
            },
            autocorrelation_plot(&format!("{name}, autocorrelation"), &self.acf),
            normalised_histogram_plot(&format!("{name}, distribution"), &self.histogram),
        ]
    }
}

/// Innovation of a reading that was used over its standard deviation.
fn innovation_over_sigma(sensor: &SensorEstimate) -> Option<f64> {
    let is_used = sensor.fault.is_none() && sensor.innovation_variance > 0.0;
    is_used.then(|| f64::from(sensor.innovation) / f64::from(sensor.innovation_variance).sqrt())
}

/// 1 where there is a fault, as plots are shaded by it.
pub(crate) fn flag(fault: Fault) -> f64 {
    f64::from(u8::from(!fault.is_none()))
}
