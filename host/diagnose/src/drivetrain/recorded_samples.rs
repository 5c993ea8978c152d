//! Reads a drivetrain recording, sample by sample in SI units: channels, loads, angles referred to
//! the main shaft, temperature rise. Further functions mask stuck values and outliers, and compute
//! speed and acceleration from an angle.

use std::f64::consts::TAU;
use std::path::Path;

use crate::diagnosis::DiagnoseError;
use crate::drivetrain::motion_sensor::integrated_speeds;
use crate::smoothing::moving_mean;
use loadtwin_identification::calibrate::Motion;
use loadtwin_machine::{Encoder, Encoding, Machine};
use loadtwin_math::count_unwrapping::unwrapped;
use loadtwin_recording::{Quantity, Reader, Role, Unit, Wanted, columns};

/// Everything that a recording holds of a machine.
pub(crate) struct DrivetrainRecording {
    pub dt_s: f64,
    /// Carrier angle, continuous [rad]; NaN where it was not measured.
    pub angle: Vec<f64>,
    /// Each load of the drivetrain in its own sign [N m]; NaN where it has no reference.
    pub loads: Vec<Vec<f64>>,
    /// Reading of each channel [SI]; NaN where missing. Stuck values and outliers are in it.
    pub channels: Vec<Vec<f64>>,
    /// Angle of each encoder, without any of each inertia whose speed is sensed; referred, from an
    /// arbitrary zero [rad].
    pub encoders: Vec<Vec<f64>>,
    /// Temperature rise above the reference temperature [K].
    pub warming: Option<Vec<f64>>,
}

/// Equal readings in a row from which a sensor is stuck: noise above the resolution does not repeat
/// so often.
const STUCK_AFTER: usize = 8;

impl DrivetrainRecording {
    pub(crate) fn read(machine: &Machine, path: &Path) -> Result<Self, DiagnoseError> {
        let motion = Motion::read(machine, path, |_| ())?;
        let n = motion.len();
        let mut angle: Vec<f64> = (0..n)
            .map(|i| motion.angle(i).unwrap_or(f64::NAN))
            .collect();
        if !motion.homed() {
            angle.fill(f64::NAN);
        }
        let loads = machine.drivetrain.as_ref().map_or(0, |d| d.loads.len());
        let loads = (0..loads)
            .map(|j| (0..n).map(|i| motion.load(j, i)).collect())
            .collect();
        let columns = SensorColumns::find(machine, path)?;
        let readings = columns.read(path, n)?;
        let warming = (machine.thermometer().zip(readings.temperature))
            .map(|(thermometer, column)| thermometer.warming(&column, 1.0 / machine.rate_hz));
        let dt_s = 1.0 / machine.rate_hz;
        Ok(Self {
            dt_s,
            encoders: if machine.encoders.is_empty() {
                integrated_speeds(machine, &readings.channels, dt_s)
            } else {
                columns.encoder_angles(&readings.encoders, &angle)
            },
            angle,
            loads,
            channels: readings.channels,
            warming,
        })
    }

    pub(crate) fn len(&self) -> usize {
        self.angle.len()
    }
}

/// The columns of channels, encoders and thermometer in one file, and the units they are read in.
struct SensorColumns<'a> {
    machine: &'a Machine,
    /// How the file has each channel.
    channels: Vec<Encoding>,
    /// Unit of each encoder: radians where the file has angles.
    encoders: Vec<Unit>,
}

/// Values of [`SensorColumns`], NaN where missing.
struct SensorReadings {
    channels: Vec<Vec<f64>>,
    encoders: Vec<Vec<f64>>,
    temperature: Option<Vec<f64>>,
}

impl<'a> SensorColumns<'a> {
    /// # Errors
    /// When the file lacks a channel or an encoder.
    fn find(machine: &'a Machine, path: &Path) -> Result<Self, DiagnoseError> {
        let channels = machine.channels.iter().map(|c| &c.name);
        let names: Vec<_> = (channels.chain(machine.encoders.iter().map(|e| &e.name)))
            .map(|name| (name.as_str(), true))
            .collect();
        let found = columns(path, &machine.recording, &names)?;
        let written = |name: &str| {
            let column = found.iter().find(|c| c.name == name);
            column.and_then(|c| c.unit.as_deref())
        };
        let holds_counts = |name: &str| {
            let unit = written(name).and_then(|unit| unit.parse::<Unit>().ok());
            unit.is_some_and(|unit| unit.quantity() == Quantity::Counts)
        };
        let encoder = |name: &str| {
            if holds_counts(name) || written(name).is_none() {
                Unit::COUNTS
            } else {
                Unit::RADIAN
            }
        };
        Ok(Self {
            machine,
            channels: (machine.channels.iter())
                .map(|channel| Encoding::of(channel, &found))
                .collect(),
            encoders: machine.encoders.iter().map(|e| encoder(&e.name)).collect(),
        })
    }

    /// `n` is the number of samples, to reserve space for.
    ///
    /// # Errors
    /// When the file cannot be read or has another rate.
    fn read(&self, path: &Path, n: usize) -> Result<SensorReadings, DiagnoseError> {
        let machine = self.machine;
        let required = |(name, unit): (&'a String, Unit)| Wanted {
            name,
            unit,
            required: true,
        };
        let channels = (machine.channels.iter().zip(&self.channels))
            .map(|(channel, encoding)| (&channel.name, encoding.unit(channel)));
        let encoders = (machine.encoders.iter().zip(&self.encoders))
            .map(|(encoder, unit)| (&encoder.name, *unit));
        let mut wanted: Vec<Wanted<'_>> = channels.chain(encoders).map(required).collect();
        let mut roles = vec![Role::Continuous; machine.channels.len()];
        let encoders = machine.encoders.iter().zip(&self.encoders);
        roles.extend(encoders.map(|(e, unit)| e.role(*unit == Unit::RADIAN)));
        let sensors = wanted.len();
        wanted.extend(machine.thermometer().map(|thermometer| Wanted {
            name: &thermometer.name,
            unit: thermometer.unit.si(),
            required: false,
        }));
        let reader = Reader::open_as(path, &machine.recording, &wanted, &roles)?
            .expect_period(1.0 / machine.rate_hz)?;
        let mut columns: Vec<Vec<f64>> = vec![Vec::with_capacity(n); wanted.len()];
        let mut has_temperature = machine.thermometer().is_some();
        for block in reader {
            let block = block?;
            for (k, (store, column)) in columns.iter_mut().zip(&block.columns).enumerate() {
                if let Some(column) = column {
                    store.extend(column);
                } else {
                    has_temperature &= k != sensors;
                    store.resize(store.len() + block.len(), f64::NAN);
                }
            }
        }
        let temperature = columns.split_off(sensors).pop();
        let encoders = columns.split_off(machine.channels.len());
        for ((channel, encoding), column) in
            (machine.channels.iter().zip(&self.channels)).zip(&mut columns)
        {
            for value in column {
                *value = encoding.reading(channel, *value);
            }
        }
        Ok(SensorReadings {
            channels: columns,
            encoders,
            temperature: temperature.filter(|_| has_temperature),
        })
    }

    /// Angle of each encoder, referred, from `readings`; `carrier` is the homed angle.
    fn encoder_angles(&self, readings: &[Vec<f64>], carrier: &[f64]) -> Vec<Vec<f64>> {
        let drivetrain = self.machine.drivetrain.as_ref();
        let ratio = |encoder: &Encoder| {
            drivetrain
                .and_then(|d| d.inertias.iter().find(|i| i.name == encoder.inertia))
                .map_or(1.0, |i| i.speed_ratio)
        };
        (self.machine.encoders.iter().zip(&self.encoders))
            .zip(readings)
            .map(|((encoder, unit), readings)| {
                let (modulus, step) = if *unit == Unit::RADIAN {
                    (f64::INFINITY, 1.0 / ratio(encoder))
                } else {
                    (
                        f64::from(encoder.bits).exp2(),
                        TAU / (encoder.counts_per_turn * ratio(encoder)),
                    )
                };
                let moved = unwrapped(readings, modulus).into_iter();
                let mut angle: Vec<f64> = moved.map(|moved| moved * step).collect();
                if encoder.eccentricity.is_some() {
                    remove_eccentricity(&mut angle, carrier, self.machine);
                }
                angle
            })
            .collect()
    }
}

/// Subtracts the error of the index's encoder by `machine`'s description; nothing where `angle`,
/// its own once homed, is not known.
fn remove_eccentricity(read: &mut [f64], angle: &[f64], machine: &Machine) {
    let known = angle.iter().position(|angle| angle.is_finite());
    let Some(zero) = known.map(|at| angle[at] - read[at]) else {
        return;
    };
    let error = machine.homed_error();
    for read in read {
        *read -= error(*read + zero);
    }
}

/// Masks readings that repeat for longer than noise allows; returns their number.
///
/// A channel that repeats by nature (of coarse counts) is not changed.
pub(crate) fn mask_stuck(y: &mut [f64]) -> u64 {
    let repeats = y.windows(2).filter(|w| w[0] == w[1]).count();
    // Where every third sample repeats by rounding, eight in a row are chance.
    let mut runs = Vec::new();
    let (mut start, mut i) = (0, 1);
    while i <= y.len() {
        if i == y.len() || y[i] != y[start] {
            if i - start >= STUCK_AFTER {
                runs.push(start..i);
            }
            start = i;
        }
        i += 1;
    }
    let in_runs: usize = runs.iter().map(|r| r.len() - 1).sum();
    if repeats - in_runs.min(repeats) > y.len() / 20 {
        return 0;
    }
    let mut count = 0;
    for run in runs {
        // The first is a reading.
        for value in &mut y[run.start + 1..run.end] {
            *value = f64::NAN;
            count += 1;
        }
    }
    count
}

/// Standard deviations by which an outlier stands out from its four neighbours.
const OUTLIER_SIGMA: f64 = 7.0;

/// Part of Gaussian samples beyond half of [`OUTLIER_SIGMA`]: `2 Q(3.5)`.
const BEYOND_HALF: f64 = 4.65e-4;

/// Samples that stand out alone.
#[derive(Default)]
pub(crate) struct Outliers {
    /// Which.
    pub at: Vec<usize>,
    /// How many of them noise with heavy tails may give.
    pub of_tail: u64,
}

/// Masks samples of `residual` that stand out from their four neighbours
/// alone by more than seven standard deviations, theirs and `noise_std`; which.
///
/// Of noise with a finite variance and a tail of any exponent `P(2 x) <= P(x) / 4`: beyond seven standard
/// deviations are at most a third of those between 3.5 and seven that a Gaussian does not explain.
pub(crate) fn mask_outliers(residual: &mut [f64], noise_std: f64) -> Outliers {
    let n = residual.len();
    if n < 16 {
        return Outliers::default();
    }
    let aside = |i: usize| {
        let mut around = [
            residual[i - 2],
            residual[i - 1],
            residual[i + 1],
            residual[i + 2],
        ];
        around.sort_by(f64::total_cmp);
        residual[i] - 0.5 * (around[1] + around[2])
    };
    let deviations: Vec<f64> = (2..n - 2).map(aside).collect();
    let mut sizes: Vec<f64> = deviations
        .iter()
        .map(|d| d.abs())
        .filter(|d| d.is_finite())
        .collect();
    if sizes.len() < 16 {
        return Outliers::default();
    }
    let middle = sizes.len() / 2;
    let median = *sizes.select_nth_unstable_by(middle, f64::total_cmp).1;
    // Without noise the counts of an encoder would stand out.
    let limit = OUTLIER_SIGMA * f64::max(median / 0.6745, noise_std);
    let at: Vec<usize> = deviations
        .iter()
        .enumerate()
        .filter(|(i, d)| {
            // Alone: its neighbours are not out the same way.
            let near = |k: usize| {
                deviations
                    .get(k)
                    .is_some_and(|o| o.is_finite() && o * **d > 0.0 && o.abs() > 0.5 * d.abs())
            };
            d.abs() > limit && limit > 0.0 && !near(i.wrapping_sub(1)) && !near(i + 1)
        })
        .map(|(i, _)| i + 2)
        .collect();
    for i in &at {
        residual[*i] = f64::NAN;
    }
    let size = |d: &&f64| d.abs() > 0.5 * limit && d.abs() <= limit;
    let between = deviations.iter().filter(size).count() as f64;
    let beyond_gaussian = between - BEYOND_HALF * sizes.len() as f64;
    Outliers {
        at,
        of_tail: (beyond_gaussian / 3.0).max(0.0).round() as u64,
    }
}

/// First and second derivative of `angle` over moving means of `width` samples.
///
/// The second is that of the angle smoothed by [`crate::smoothing::smooth`].
pub(crate) fn derivatives(angle: &[f64], width: usize, dt_s: f64) -> (Vec<f64>, Vec<f64>) {
    let n = angle.len();
    let first = angle.first().copied().unwrap_or(0.0);
    let slope = (angle.last().copied().unwrap_or(0.0) - first) / n.max(2) as f64;
    // Deviations from uniform motion, so that the sums stay small.
    let bent: Vec<f64> = angle
        .iter()
        .enumerate()
        .map(|(i, a)| a - first - slope * i as f64)
        .collect();
    let mean = moving_mean(&bent, width);
    let at = |i: isize| mean[i.clamp(0, n as isize - 1) as usize];
    let h = width as isize;
    let span = width as f64 * dt_s;
    let half = h / 2;
    let short = 2.0 * half as f64 * dt_s;
    // Where the means do not reach, as where they just do.
    let (from, to) = (h + half, n as isize - 1 - h - half);
    (0..n as isize)
        .map(|i| {
            let i = if from < to { i.clamp(from, to) } else { i };
            (
                (at(i + half) - at(i - half)) / short + slope / dt_s,
                (at(i + h) - 2.0 * at(i) + at(i - h)) / (span * span),
            )
        })
        .unzip()
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;
    use rand_distr::{Distribution, Normal, StudentT};

    use super::*;

    /// Outliers of 40 000 samples of noise of unit deviation, of which every 2000th is off by 20.
    fn outliers(noise: impl Distribution<f64>, has_spikes: bool) -> Outliers {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut samples: Vec<f64> = (0..40_000).map(|_| rng.sample(&noise)).collect();
        if has_spikes {
            samples
                .iter_mut()
                .step_by(2000)
                .skip(1)
                .for_each(|x| *x += 20.0);
        }
        mask_outliers(&mut samples, 1.0)
    }

    #[test]
    fn the_tail_of_noise_gives_outliers_and_is_no_fault() {
        let normal = Normal::new(0.0, 1.0).unwrap();
        let clean = outliers(normal, false);
        assert_eq!((clean.at.len(), clean.of_tail), (0, 0));
        let spoilt = outliers(normal, true);
        assert_eq!(spoilt.at.len(), 19);
        assert!(spoilt.of_tail <= 1, "{}", spoilt.of_tail);
        // Unit deviation: 5 / 3 is the variance of five degrees of freedom.
        let heavy = StudentT::new(5.0)
            .unwrap()
            .map(|x| x / (5.0_f64 / 3.0).sqrt());
        let heavy = outliers(heavy, false);
        assert!(heavy.at.len() >= 5, "{}", heavy.at.len());
        assert!(heavy.of_tail >= heavy.at.len() as u64, "{}", heavy.of_tail);
    }
}
