//! Searches the cause of a disagreement between description and recording: replays the beginning of
//! the recording under each hypothesis, and gives the most likely one if it restores consistency,
//! with those that the likelihood does not distinguish from it.

use std::f64::consts::{PI, TAU};
use std::path::Path;

use loadtwin_common::estimator::Estimator;
use loadtwin_common::image::Image;
use loadtwin_common::io::estimate::Estimate;
use loadtwin_common::io::fault::Fault;
use rayon::prelude::*;

use super::hypothesis::{self, Hypothesis, SHIFTS};
use super::{CONTRADICTING, Cause, SensorConsistency, contradicts, reference_loads::Reference};
use crate::samples::{IndexColumn, index_column};
use crate::{ReplayError, Sample, Samples};
use loadtwin_design::image_build::{self, Sensors};
use loadtwin_machine::Machine;

/// Samples beyond the first contradiction by which all causes are compared.
const FIRST: u64 = 4_000;

/// Samples beyond the first contradiction by which the best causes are compared again.
const AGAIN: u64 = 20_000;

/// Samples by which the best are compared where no reading contradicts and a sensor is biased in the
/// mean of the recording: some seconds for each cause.
const MEAN: u64 = 1_000_000;

/// Causes that are compared again.
const BEST: usize = 8;

/// Part of the readings that are outliers, uniform over the spread of the readings.
const OUTLIERS: f64 = 1e-3;

/// Part of the disagreement that is left at most where a cause explains it.
const LEFT: f64 = 0.25;

/// Part of the samples with a valid load that must stay valid: where a correction makes the loads
/// not valid, nothing is compared any more that could contradict it.
const STAYS_VALID: f64 = 0.9;

/// Logarithm of the likelihood, for a reading, by which a cause has to be better than none, and for
/// each of its numbers that was fitted.
const BETTER: f64 = 0.01;

/// Causes beside the most likely one that are named where their likelihood is not lower by [`BETTER`].
const ALTERNATIVES: usize = 2;

/// Rounds of refinement. The angle of the index pulse is found to a thousandth of a turn. With three
/// gauges, each round leaves a third of the error of a zero or a scale.
const REFINED: u32 = 3;

/// Residuals of one sensor or reference.
#[derive(Clone, Default)]
struct Residuals {
    /// Normalised residual squared and logarithm of its variance.
    read: Vec<[f32; 2]>,
    contradicting: u64,
    refused: u64,
    /// Number, sum and squares of the readings.
    moments: [f64; 3],
}

impl Residuals {
    fn push(&mut self, reading: f64, nis: f64, log_variance: f64, contradicts: bool) {
        self.contradicting += u64::from(contradicts);
        self.read.push([nis as f32, log_variance as f32]);
        self.moments[0] += 1.0;
        self.moments[1] += reading;
        self.moments[2] += reading * reading;
    }

    /// Mean logarithm of the density of normal noise with outliers, over that of outliers alone.
    fn log_likelihood(&self) -> (f64, u64) {
        let [n, sum, squares] = self.moments;
        let count = self.read.len() as u64 + self.refused;
        // Uniform of the same variance as the readings.
        let width = (12.0 * (squares / n - (sum / n).powi(2))).max(0.0).sqrt();
        let of = |[nis, log_variance]: &[f32; 2]| {
            let log_density = -0.5 * f64::from(nis + log_variance + std::f32::consts::TAU.ln());
            (OUTLIERS + (1.0 - OUTLIERS) * width * log_density.exp()).ln()
        };
        let read: f64 = self.read.iter().map(of).filter(|l| l.is_finite()).sum();
        (read + self.refused as f64 * OUTLIERS.ln(), count)
    }

    fn part_beyond(&self) -> f64 {
        let beyond = self.contradicting + self.refused;
        beyond as f64 / (self.read.len() as u64 + self.refused).max(1) as f64
    }
}

/// What one replay came to.
struct Outcome {
    /// Mean logarithm of the likelihood of a reading.
    log_likelihood: f64,
    /// Part of the readings beyond three standard deviations of the worst sensor, and reference.
    beyond: [f64; 2],
    /// Samples in which some load is valid.
    valid: u64,
    /// Each sensor, its readings as corrected.
    sensors: Vec<SensorConsistency>,
}

/// A recording, and what is compared with it.
struct Comparison<'a> {
    machine: &'a Machine,
    sensors: &'a Sensors,
    path: &'a Path,
    index: Option<IndexColumn>,
    /// The payload of the image as described: that of a rotor takes half a second.
    described: Vec<u8>,
}

impl Comparison<'_> {
    /// The hypotheses on the samples up to `until`, the most likely first.
    fn of(&self, hypotheses: Vec<Hypothesis>, until: u64) -> Vec<(Hypothesis, Outcome)> {
        let mut tried: Vec<(Hypothesis, Outcome)> = hypotheses
            .into_par_iter()
            .filter_map(|h| {
                let outcome = self.outcome(&h, until)?;
                Some((h, outcome))
            })
            .collect();
        tried.sort_by(|a, b| b.1.log_likelihood.total_cmp(&a.1.log_likelihood));
        tried
    }

    fn outcome(&self, hypothesis: &Hypothesis, until: u64) -> Option<Outcome> {
        let (machine, sensors) = (self.machine, self.sensors);
        let samples = Samples::with_index(machine, sensors, self.path, self.index.clone()).ok()?;
        let payload;
        let image = if hypothesis.rate == 1.0 && hypothesis.index_rad == 0.0 {
            Image::from_bytes(&self.described)
        } else {
            let mut other = machine.clone();
            other.rate_hz *= hypothesis.rate;
            if let Some(index) = &mut other.index {
                let angle = index.angle_rad + hypothesis.index_rad;
                index.angle_rad = (angle + PI).rem_euclid(TAU) - PI;
            }
            payload = image_build::image(&other, sensors).ok()?;
            Image::from_bytes(&payload)
        };
        let mut estimator = Estimator::try_build(image.ok()?).ok()?;
        let compared = (machine, sensors);
        let mut outcome = replayed(compared, &mut estimator, samples, hypothesis, until).ok()?;
        outcome.log_likelihood -= BETTER * f64::from(hypothesis.fitted);
        Some(outcome)
    }

    /// Zero and scale fitted again to the samples up to `until`, in [`REFINED`] rounds.
    fn refitted(&self, mut hypothesis: Hypothesis, until: u64) -> Hypothesis {
        let Some(channel) = hypothesis.fitted_channel else {
            return hypothesis;
        };
        for _ in 0..REFINED {
            let refitted = self
                .outcome(&hypothesis, until)
                .and_then(|outcome| hypothesis.refitted(self.sensors, &outcome.sensors[channel]));
            match refitted {
                Some(refitted) => hypothesis = refitted,
                None => break,
            }
        }
        hypothesis
    }

    /// The angle of the index pulse near `shift` [rad] that fits best, by a grid four times as fine
    /// in each round.
    fn refined(&self, described: &Hypothesis, shift: f64, until: u64) -> Option<Hypothesis> {
        let mut best = shift;
        let mut step = TAU / f64::from(SHIFTS);
        for _ in 0..REFINED {
            step /= 4.0;
            let grid = (-3..=3).map(|k| best + step * f64::from(k));
            let near = grid.filter_map(|by| described.homed_at(self.machine, by));
            best = self.of(near.collect(), until).first()?.0.index_rad;
        }
        described.homed_at(self.machine, best)
    }
}

/// The cause that explains the recording in `path` from sample `from` on, if one does; without `from`,
/// over the recording as a whole. Causes that the likelihood does not distinguish are named together.
pub(super) fn cause(
    (machine, sensors): (&Machine, &Sensors),
    path: &Path,
    found: &[SensorConsistency],
    from: Option<u64>,
) -> Option<Cause> {
    let all = hypothesis::all(machine, sensors, found);
    let index = index_column(machine, sensors, path.into()).ok()?;
    let comparison = Comparison {
        machine,
        sensors,
        path,
        index,
        described: image_build::image(machine, sensors).ok()?,
    };
    let described = all.first()?.clone();
    let until = from.unwrap_or(0) + FIRST;
    let first = comparison.of(all, until).into_iter().map(|(h, _)| h);
    let likely = (first.enumerate()).filter(|(rank, h)| *rank < BEST || h.fitted_channel.is_some());
    let mut best: Vec<Hypothesis> = likely.map(|(_, h)| h).collect();
    best.retain(|h| h.kind != described.kind);
    if let Some(place) = best.iter().position(|h| h.index_rad != 0.0) {
        let shift = best[place].index_rad;
        best.retain(|h| h.index_rad == 0.0);
        best.extend(comparison.refined(&described, shift, until));
    }
    best.push(described);
    let until = from.map_or(MEAN, |from| from + AGAIN);
    let best = (best.into_par_iter()).map(|h| comparison.refitted(h, until));
    let again = comparison.of(best.collect(), until);
    let described = &again.iter().find(|(h, _)| h.kind == "none")?.1;
    // Where all readings are refused, or the references are no part of it, one that does not explain
    // the recording may be more likely than the one that does.
    let explains = |outcome: &Outcome| {
        outcome.log_likelihood > described.log_likelihood + BETTER
            && outcome.valid as f64 >= STAYS_VALID * described.valid as f64
            && (outcome.beyond.iter().zip(described.beyond))
                .all(|(after, before)| *after < CONTRADICTING.max(LEFT * before))
    };
    let mut explaining = again.iter().filter(|(_, outcome)| explains(outcome));
    let (found, outcome) = explaining.next()?;
    let alike = explaining
        .filter(|(_, other)| outcome.log_likelihood - other.log_likelihood < BETTER)
        .take(ALTERNATIVES)
        .map(|(other, _)| other.what.as_str());
    let what: Vec<&str> = std::iter::once(found.what.as_str()).chain(alike).collect();
    Some(Cause {
        kind: found.kind,
        what: what.join(", or "),
        corrected_percent: Some(100.0 * outcome.beyond[0]),
        remedy: found.remedy.clone(),
    })
}

/// The samples up to `until`, read as the hypothesis says.
fn replayed(
    (machine, sensors): (&Machine, &Sensors),
    estimator: &mut Estimator,
    samples: Samples,
    hypothesis: &Hypothesis,
    until: u64,
) -> Result<Outcome, ReplayError> {
    let mut samples = samples.corrected(hypothesis.correction.clone());
    let of = Reference::all(machine);
    let names = sensors.names();
    let mut read = vec![Residuals::default(); names.len()];
    let mut found: Vec<SensorConsistency> =
        names.into_iter().map(SensorConsistency::named).collect();
    let mut references = Residuals::default();
    let (mut count, mut valid) = (0, 0);
    while count < until {
        let more = samples.next_block(|sample| {
            count += 1;
            if count > until {
                return;
            }
            let estimate = estimator.step(&sample.raw);
            let is_valid = estimate.loads.iter().any(|load| load.fault.is_none());
            valid += u64::from(is_valid);
            push(&mut read, &estimate);
            for (sensor, read) in found.iter_mut().zip(&estimate.sensors) {
                sensor.push(read);
            }
            let scaled: Vec<f64> = (sample.references.iter().zip(&hypothesis.references))
                .map(|(value, factor)| value * factor)
                .collect();
            let sample = Sample {
                references: &scaled,
                ..*sample
            };
            for (reference, value) in of.iter().zip(sample.references) {
                if let Some(residual) = reference.residual(*value, &estimate) {
                    let (nis, log_variance) = (residual.nis, residual.log_variance);
                    references.push(*value, nis, log_variance, residual.is_beyond);
                }
            }
        })?;
        if !more {
            break;
        }
    }
    let (mut sum, mut readings) = (0.0, 0);
    for (log_likelihood, count) in read
        .iter()
        .chain([&references])
        .map(Residuals::log_likelihood)
    {
        sum += log_likelihood;
        readings += count;
    }
    let worst = read.iter().map(Residuals::part_beyond).fold(0.0, f64::max);
    found.iter_mut().for_each(SensorConsistency::sum_up);
    Ok(Outcome {
        log_likelihood: sum / readings.max(1) as f64,
        beyond: [worst, references.part_beyond()],
        valid,
        sensors: found,
    })
}

fn push(read: &mut [Residuals], estimate: &Estimate) {
    for (residuals, sensor) in read.iter_mut().zip(&estimate.sensors) {
        if sensor.innovation_variance > 0.0 {
            let variance = f64::from(sensor.innovation_variance);
            let contradicts = contradicts(sensor) == Some(true);
            let (reading, nis) = (sensor.measured.into(), sensor.nis.into());
            residuals.push(reading, nis, variance.ln(), contradicts);
        } else if !matches!(
            sensor.fault,
            Fault::None | Fault::Missing | Fault::NotHomed | Fault::NotValid
        ) {
            residuals.refused += 1;
        }
    }
}
