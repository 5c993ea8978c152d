//! Computes sensitivity and noise variance of a channel over the carrier angle as tables of the
//! model image: f32, little endian, lengths of powers of two. They are scaled so that readings are
//! about 100 to 1000 at nominal load.

use crate::error::BuildError;
use loadtwin_machine::{Drivetrain, MAP_ENTRIES, Machine, resampled};

/// The tables of one channel, as they lie in the image.
pub(crate) struct Tables {
    /// Unit of the filter's reading, a power of ten (SI).
    pub unit: f64,
    /// What the channel senses at nominal loads and speed (SI).
    pub sensed: f64,
    /// Mean of the sensitivity over the angle (SI).
    pub mean: f64,
    /// Standard deviation of the sensitivity over the angle (SI).
    pub deviation: f64,
    /// Root mean square of the noise over the angle [SI].
    pub noise: f64,
    /// The map of the description, in 1 or in [`MAP_ENTRIES`] steps [SI].
    sensitivity: Vec<f64>,
    /// Response to what is sensed at nominal, in `unit`, over the angle.
    pub map: Vec<u8>,
    /// Variance of the noise, in `unit` squared, over bins of the angle.
    pub variance: Vec<u8>,
}

impl Tables {
    pub fn new(
        machine: &Machine,
        drivetrain: &Drivetrain,
        channel: &loadtwin_machine::Channel,
    ) -> Result<Self, BuildError> {
        let map = powered(&channel.sensitivity_over_angle(machine)?);
        let noise = channel.noise_over_angle(machine)?;
        let sensed = drivetrain.nominal_sensed(&channel.senses);
        let peak = map.iter().fold(0.0_f64, |peak, m| peak.max(m.abs()));
        // Readings are of the order of 100 at the nominal load.
        let unit = 10.0_f64.powf((peak * sensed).log10().floor() - 2.0);
        let mean = map.iter().sum::<f64>() / map.len() as f64;
        let deviation =
            (map.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / map.len() as f64).sqrt();
        let bins = noise.len().next_power_of_two();
        let variance = (0..bins).map(|i| (noise[i * noise.len() / bins] / unit).powi(2));
        Ok(Self {
            unit,
            sensed,
            mean,
            deviation,
            noise: (noise.iter().map(|n| n * n).sum::<f64>() / noise.len() as f64).sqrt(),
            variance: little_endian(variance),
            map: little_endian(map.iter().map(|m| m * sensed / unit)),
            sensitivity: map,
        })
    }

    /// Response to the nominal load at step `step` of [`MAP_ENTRIES`] over the angle [SI].
    pub fn response(&self, step: usize) -> f64 {
        let entry = self.sensitivity.get(step).or(self.sensitivity.first());
        entry.map_or(0.0, |m| m * self.sensed)
    }

    /// Root mean square of the response to the nominal load over the angle [SI].
    pub fn rms_response(&self) -> f64 {
        self.mean.hypot(self.deviation) * self.sensed
    }
}

/// A map in 1 or in [`MAP_ENTRIES`] steps.
fn powered(values: &[f64]) -> Vec<f64> {
    if values.len() == 1 {
        values.to_vec()
    } else {
        resampled(values, MAP_ENTRIES)
    }
}

fn little_endian(values: impl Iterator<Item = f64>) -> Vec<u8> {
    values
        .flat_map(|value| (value as f32).to_le_bytes())
        .collect()
}
