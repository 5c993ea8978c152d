//! Runs a drivetrain's estimator with a given load noise on recordings in memory, and computes the
//! likelihood of the innovations, innovation and solution norm, and the error of the loads.

use loadtwin_common::drivetrain::{GearboxModel, Role};
use loadtwin_common::estimator::Estimator;
use loadtwin_common::image::{Image, Model};
use loadtwin_common::io::estimate::Estimate;

use crate::tune::TuneError;
use crate::tune::training_recordings::{Start, Training, starts};
use loadtwin_design::image_build::Sensors;
use loadtwin_machine::Machine;
use loadtwin_replay::ReplayError;

/// Time at the start that does not count, in which the filter converges [s].
const SETTLING_S: f64 = 2.0;

/// Recordings in memory, and the image that is tried on them.
pub struct Trial<'a> {
    image: Image<'a>,
    recordings: Vec<Start>,
    /// For each reference, the load that it measures.
    load_of: Vec<Option<usize>>,
    /// Standard deviation of each channel and encoder [SI].
    noise: Vec<f64>,
    skip: usize,
}

/// Objectives of a trial with one load noise; each is a mean over samples.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Outcome {
    /// `1/2 (ln S + nu^2 / S)`, summed over the sensors: the negative logarithm of
    /// the likelihood, up to a constant.
    pub misfit: f64,
    /// Innovation norm: squared innovations over the sensors, in units of their noise.
    pub innovation: f64,
    /// Solution norm: squared loads, in nominal loads.
    pub load: f64,
    /// Mean absolute error of the loads that have a reference [% of nominal]; none without reference.
    pub error_percent: Option<f64>,
}

impl<'a> Trial<'a> {
    /// Reads the start of each recording of `training`; `payload` is the image's.
    ///
    /// # Errors
    /// When a recording or the image cannot be read.
    pub fn new(
        machine: &Machine,
        sensors: &Sensors,
        payload: &'a [u8],
        training: Training<'_>,
    ) -> Result<Self, TuneError> {
        let image = Image::from_bytes(payload).map_err(ReplayError::Image)?;
        let Model::Gearbox(model) = &image.model else {
            return Err(crate::calibrate::CalibrateError::NoDrivetrain.into());
        };
        Ok(Self {
            noise: noise(model),
            recordings: starts(machine, sensors, training)?,
            load_of: machine.load_of_references(),
            skip: (SETTLING_S * machine.rate_hz) as usize,
            image,
        })
    }

    /// Runs the estimator with steps of the loads of variance `load_noise`, in
    /// nominal loads squared, and no reading left out; infinite where it is refused.
    pub fn run(&self, load_noise: &[f64]) -> Outcome {
        let infinite = Outcome {
            misfit: f64::INFINITY,
            innovation: f64::INFINITY,
            load: f64::INFINITY,
            error_percent: None,
        };
        let mut image = self.image.clone();
        let Model::Gearbox(model) = &mut image.model else {
            return infinite;
        };
        for (slot, variance) in model.load_noise.iter_mut().zip(load_noise) {
            *slot = *variance as f32;
        }
        model.gate_nis = f32::MAX;
        let first = model.scale.len() - model.load_noise.len();
        let nominal: Vec<f64> = (model.scale.iter().skip(first).copied())
            .map(f64::from)
            .collect();
        let (mut sum, mut count) = (Outcome::default(), 0);
        let (mut errors, mut compared) = (0.0, 0_u32);
        for recording in &self.recordings {
            let Ok(mut line) = Estimator::try_build(image.clone()) else {
                return infinite;
            };
            for (k, (raw, references)) in
                recording.raw.iter().zip(&recording.references).enumerate()
            {
                let estimate = line.step(raw);
                if k < self.skip {
                    continue;
                }
                count += 1;
                self.add_innovations(&estimate, &mut sum);
                for (reference, j) in references.iter().zip(&self.load_of) {
                    if let Some(j) = *j
                        && let (Some(load), Some(nominal)) = (estimate.loads.get(j), nominal.get(j))
                        && reference.is_finite()
                    {
                        errors += ((f64::from(load.value) - reference) / nominal).abs();
                        compared += 1;
                    }
                }
                for (load, nominal) in estimate.loads.iter().zip(&nominal) {
                    sum.load += (f64::from(load.value) / nominal).powi(2);
                }
            }
        }
        let mean = |value: f64| {
            if value.is_finite() {
                value / f64::from(count.max(1))
            } else {
                f64::INFINITY
            }
        };
        Outcome {
            misfit: mean(sum.misfit),
            innovation: mean(sum.innovation),
            load: mean(sum.load),
            error_percent: (compared > 0).then(|| 100.0 * errors / f64::from(compared)),
        }
    }

    /// Adds the innovations of one sample to misfit and innovation norm.
    fn add_innovations(&self, estimate: &Estimate, sum: &mut Outcome) {
        for (sensor, noise) in estimate.sensors.iter().zip(&self.noise) {
            let (nu, s) = (
                f64::from(sensor.innovation),
                f64::from(sensor.innovation_variance),
            );
            if s > 0.0 {
                // In units of the noise, so that channels of any unit add up.
                sum.misfit += 0.5 * ((s / (noise * noise)).ln() + nu * nu / s);
                sum.innovation += (nu / noise).powi(2);
            }
        }
    }
}

/// Standard deviation of each reading, the mean over the carrier angle [SI].
fn noise(model: &GearboxModel<'_>) -> Vec<f64> {
    let channels = model.channels.iter().map(|channel| match &channel.role {
        Role::Measure { variance, .. } => {
            let bins = variance.len();
            let sum: f64 = (0..bins).map(|i| f64::from(variance.entry(i))).sum();
            (sum / bins as f64).sqrt() * f64::from(channel.unit)
        }
        Role::Drive | Role::Temperature { .. } => 1.0,
    });
    channels
        .chain(model.encoders.iter().map(|e| f64::from(e.variance).sqrt()))
        .collect()
}
