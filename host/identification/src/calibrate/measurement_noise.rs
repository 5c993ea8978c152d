//! Computes the measurement noise of a channel over 128 bins of the carrier angle from the errors
//! of its model: their standard deviation plus twice their mean, plain and scaled by the reading.

use std::path::PathBuf;

use crate::calibrate::{CalibrateError, Moments, Observations, fine};
use loadtwin_machine::Machine;

/// Bins of the carrier angle.
pub const NOISE_BINS: usize = 128;

/// Standard deviation of a channel about its model (SI), over bins of the carrier angle.
#[derive(Clone, Debug)]
pub struct MeasurementNoise {
    /// `sigma* = 2 |mean error| F + std of the error`, eq. (17).
    pub scaled: Vec<f64>,
    /// `sigma = 2 |mean error| + std of the error`, eq. (15).
    pub plain: Vec<f64>,
}

impl MeasurementNoise {
    /// From the errors between the readings and the model `offset + map s`.
    ///
    /// `F = (peak - |mean reading|) / peak`, with the mean reading of the bin
    /// above `offset`, and its peak over the turn: where a gauge says most, its
    /// mean error counts least. A bin with fewer than two samples takes the mean of the
    /// others; nothing is below `floor`, the converter's own noise.
    ///
    /// Source: Bosmans et al. 2023, eq. (15), (17), (18).
    pub fn new(moments: &Moments, offset: f64, map: &[f64], floor: f64) -> Self {
        let per_bin = moments.bins().len() / NOISE_BINS;
        let offset = offset - moments.origin();
        let map = fine(map, 0.0);
        let statistics: Vec<Option<[f64; 3]>> = moments
            .bins()
            .chunks(per_bin)
            .zip(map.chunks(per_bin))
            .map(|(bins, map)| {
                let n: f64 = bins.iter().map(|bin| bin.n).sum();
                let pairs = || bins.iter().zip(map);
                let error: f64 = pairs().map(|(bin, m)| bin.error(offset, *m)).sum::<f64>() / n;
                let square: f64 = pairs()
                    .map(|(bin, m)| bin.squared_error(offset, *m))
                    .sum::<f64>()
                    / n;
                let reading = bins.iter().map(|bin| bin.y).sum::<f64>() / n - offset;
                let deviation = (square - error * error).max(0.0).sqrt();
                (n > 1.0).then_some([error.abs(), deviation, reading.abs()])
            })
            .collect();
        let peak = statistics
            .iter()
            .flatten()
            .fold(0.0_f64, |peak, s| peak.max(s[2]));
        let filled = |sigma: &dyn Fn(&[f64; 3]) -> f64| {
            let known: Vec<f64> = statistics
                .iter()
                .flatten()
                .map(|s| sigma(s).max(floor))
                .collect();
            let mean = known.iter().sum::<f64>() / known.len().max(1) as f64;
            let value =
                |s: &Option<[f64; 3]>| s.as_ref().map_or(mean.max(floor), |s| sigma(s).max(floor));
            statistics.iter().map(value).collect()
        };
        Self {
            scaled: filled(&|[error, deviation, reading]| {
                let factor = if peak > 0.0 {
                    (peak - reading) / peak
                } else {
                    1.0
                };
                2.0 * error * factor + deviation
            }),
            plain: filled(&|[error, deviation, _]| 2.0 * error + deviation),
        }
    }
}

/// The noise of every channel of `machine` about its model, by the channel's
/// number, from the first `part` (0 to 1) of a recording at constant load with reference loads.
///
/// # Errors
/// When the recording cannot be used or a map cannot be read.
pub fn measure_noise(
    machine: &Machine,
    recording: &PathBuf,
    part: f64,
    progress: impl FnMut(f64),
) -> Result<Vec<(usize, MeasurementNoise)>, CalibrateError> {
    let recordings = std::slice::from_ref(recording);
    let observations = Observations::read_part(machine, recordings, part, progress)?;
    let mut noise = Vec::new();
    for (i, (channel, moments)) in machine
        .channels
        .iter()
        .zip(&observations.channels)
        .enumerate()
    {
        // What a state of the filter follows is no noise, but in these errors.
        let unbent = |_: &&Moments| channel.bending == 0.0;
        let observed = |m: &&Moments| m.total().n > 0.0;
        if let Some(moments) = moments.as_ref().filter(unbent).filter(observed) {
            let map = channel.sensitivity_over_angle(machine)?;
            let floor = channel.lsb_si().abs() / 12.0_f64.sqrt();
            let offset = channel.to_si(channel.offset);
            noise.push((i, MeasurementNoise::new(moments, offset, &map, floor)));
        }
    }
    Ok(noise)
}

/// A step function with as many equal steps.
pub fn step_function(values: &[f64], steps: usize) -> Vec<f64> {
    (0..steps)
        .map(|i| values[i * values.len() / steps])
        .collect()
}

/// Root of the mean square.
pub fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    /// Readings 10 s, 2 s and 0 s in quarters of the turn (the last one 0 as
    /// well), with errors +3 and +1 on them.
    #[test]
    fn a_mean_error_counts_less_where_the_gauge_says_more() {
        let levels = [10.0, 2.0, 0.0, 0.0];
        let mut moments = Moments::default();
        for i in 0..512_u32 {
            let angle = TAU * (f64::from(i) + 0.5) / 512.0;
            for error in [3.0, 1.0] {
                moments.push(angle, 1.0, levels[i as usize / 128] + error);
            }
        }
        let map: Vec<f64> = (0..512).map(|i| levels[i / 128]).collect();
        let noise = MeasurementNoise::new(&moments, 0.0, &map, 0.1);
        // Mean error 2, deviation 1, mean readings 12, 4, 2 with peak 12.
        for (bin, factor) in [(16, 0.0), (48, 8.0 / 12.0), (80, 10.0 / 12.0)] {
            assert!(
                (noise.plain[bin] - 5.0).abs() < 1e-9,
                "{}",
                noise.plain[bin]
            );
            assert!((noise.scaled[bin] - (4.0 * factor + 1.0)).abs() < 1e-9);
        }
    }
}
