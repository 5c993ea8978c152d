//! Runs a rotor's filter with changed noise on recordings in memory, and computes the likelihood of
//! the innovations and the two objectives of Rezende et al. 2023, sums of `1 - R^2` over the
//! sensors.

use std::f64::consts::{PI, TAU};
use std::ops::Range;

use faer::Mat;
use loadtwin_common::estimator::Estimator;
use loadtwin_common::image::{Image, Model};
use loadtwin_common::io::estimate::Estimate;
use loadtwin_common::io::raw::RawSample;
use loadtwin_common::rotor::{PackedF32, RotorModel as ImageModel};

use crate::tune::{Training, TuneError, starts};
use loadtwin_design::image_build::{BuildError, Sensors};
use loadtwin_design::rotor::RotorFilterDesign;
use loadtwin_machine::{Machine, Rotor};
use loadtwin_replay::ReplayError;

/// Largest spread before the first sample that a description may have.
const MOST_INITIAL: f64 = 10.0;

/// Recordings in memory, and the image that is tried on them.
pub struct Trial<'a> {
    machine: &'a Machine,
    rotor: &'a Rotor,
    sensors: &'a Sensors,
    plan: RotorFilterDesign,
    image: Image<'a>,
    /// Transition of the whole state at each speed of the tables, in the filter's scale.
    transitions: Vec<(f64, Mat<f64>)>,
    recordings: Vec<Vec<RawSample>>,
}

/// Objectives of a trial with one noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outcome {
    /// `1/2 (ln S + nu^2 / S)`, summed over the sensors, mean over samples: the negative
    /// logarithm of the likelihood, up to a constant.
    pub misfit: f64,
    /// The two objectives of the paper, each a sum of `1 - R^2` over the sensors.
    pub objectives: [f64; 2],
}

impl Outcome {
    /// Outcome of a filter that cannot be built or run: the worst of all.
    const REFUSED: Self = Self {
        misfit: f64::INFINITY,
        objectives: [f64::INFINITY; 2],
    };
}

impl<'a> Trial<'a> {
    /// Reads the start of each recording of `training`; `payload` is the image's.
    ///
    /// # Errors
    /// When a recording or the image cannot be read.
    pub fn new(
        machine: &'a Machine,
        rotor: &'a Rotor,
        sensors: &'a Sensors,
        payload: &'a [u8],
        training: Training<'_>,
    ) -> Result<Self, TuneError> {
        let plan = RotorFilterDesign::new(machine, rotor, &sensors.channels)?;
        Ok(Self {
            machine,
            rotor,
            sensors,
            transitions: plan.transitions()?,
            plan,
            image: Image::from_bytes(payload).map_err(ReplayError::Image)?,
            recordings: starts(machine, sensors, training)?
                .into_iter()
                .map(|start| start.raw)
                .collect(),
        })
    }

    /// The description with its noise changed by `decades`: walk of each load, model error,
    /// spread before the first sample, noise of each sensor.
    pub fn machine_at(&self, decades: &[f64]) -> Machine {
        let mut machine = self.machine.clone();
        let mut factors = decades.iter().map(|x| 10.0_f64.powf(*x));
        let mut next = || factors.next().unwrap_or(1.0);
        if let Some(rotor) = &mut machine.rotor {
            for load in &mut rotor.loads {
                load.walk_n_per_sqrt_s = Some(load.walk(rotor.speed_rad_s) * next());
            }
            let reduction = &mut rotor.reduction;
            reduction.model_std = (reduction.model_std * next()).min(1.0);
            reduction.initial_std = (reduction.initial_std * next()).min(MOST_INITIAL);
        }
        for sensor in &self.sensors.channels {
            let factor = next();
            let named = machine
                .channels
                .iter_mut()
                .filter(|c| c.name == sensor.name);
            named.for_each(|channel| channel.noise_std *= factor);
        }
        machine
    }

    /// Runs the full recursion with the noise of [`Trial::machine_at`], no reading left
    /// out; infinite where it is refused.
    pub fn run(&self, decades: &[f64]) -> Outcome {
        let machine = self.machine_at(decades);
        self.run_machine(&machine).unwrap_or(Outcome::REFUSED)
    }

    /// That of the speed at which the shaft turned by `turned` [rad] in a sample.
    fn transition(&self, turned: f32) -> &Mat<f64> {
        let turned = (f64::from(turned) + PI).rem_euclid(TAU) - PI;
        let speed = turned * self.machine.rate_hz;
        let near = |(at, _): &&(f64, Mat<f64>)| (at - speed).abs();
        let nearest = self
            .transitions
            .iter()
            .min_by(|a, b| near(a).total_cmp(&near(b)));
        nearest.map_or(&self.transitions[0].1, |(_, transition)| transition)
    }

    fn run_machine(&self, machine: &Machine) -> Result<Outcome, BuildError> {
        let [q, p] = self
            .plan
            .noise(machine.rotor.as_ref().unwrap_or(self.rotor))?;
        let mut image = self.image.clone();
        let Model::Rotor(model) = &mut image.model else {
            return Ok(Outcome::REFUSED);
        };
        // The noise that is tried alone, without larger ones.
        model.levels.truncate(1);
        let Some(noise) = model.levels.first_mut() else {
            return Ok(Outcome::REFUSED);
        };
        noise.process = PackedF32::new(&q);
        noise.full_samples = u32::MAX;
        model.initial_covariance = PackedF32::new(&p);
        for (channel, sensor) in model.channels.iter_mut().zip(&self.sensors.channels) {
            let is = |c: &&loadtwin_machine::Channel| c.name == sensor.name;
            if let Some(changed) = machine.channels.iter().find(is) {
                channel.variance *= (changed.noise_std / sensor.noise_std).powi(2) as f32;
            }
        }
        model.gate_nis = f32::MAX;
        let mut fit = Fit::new(model);
        let mut misfit = 0.0;
        for recording in &self.recordings {
            let mut line = Estimator::try_build(image.clone()).map_err(BuildError::Model)?;
            let mut forced = vec![0.0; self.transitions[0].1.nrows()];
            let mut angle = None;
            for raw in recording {
                let estimate = line.step(raw);
                for sensor in estimate.sensors.iter().take(fit.rows.len()) {
                    let s = f64::from(sensor.innovation_variance);
                    if s > 0.0 {
                        misfit += 0.5 * (s.ln() + f64::from(sensor.innovation).powi(2) / s);
                    }
                }
                let last = angle
                    .replace(estimate.angle_rad)
                    .unwrap_or(estimate.angle_rad);
                forced = moved(self.transition(estimate.angle_rad - last), &forced);
                let (state, driving) = (line.rotor_state(), fit.driving.clone());
                for (force, estimated) in forced[driving.clone()].iter_mut().zip(&state[driving]) {
                    *force = f64::from(*estimated);
                }
                fit.push(&estimate, state, &forced);
            }
        }
        let misfit = misfit / fit.count.max(1.0);
        let objectives = fit.objectives();
        let finite = misfit.is_finite() && objectives.iter().all(|f| f.is_finite());
        Ok(if finite {
            Outcome { misfit, objectives }
        } else {
            Outcome::REFUSED
        })
    }
}

/// `F x`.
fn moved(f: &Mat<f64>, x: &[f64]) -> Vec<f64> {
    let mut next = vec![0.0; x.len()];
    for (column, value) in f.col_iter().zip(x) {
        for (sum, f) in next.iter_mut().zip(column.iter()) {
            *sum += f * value;
        }
    }
    next
}

/// How a sensor reads the state.
struct SensorRow {
    modal: Vec<f64>,
    bias: Option<usize>,
    /// Size of its unit [m].
    unit: f64,
}

/// Sums of which `R^2` is made, of the readings and of two estimates of each.
struct Fit {
    rows: Vec<SensorRow>,
    /// States that are forces.
    driving: Range<usize>,
    count: f64,
    /// For each sensor: sum and squares of its readings, squares of both errors.
    sums: Vec<[f64; 4]>,
}

impl Fit {
    fn new(model: &ImageModel<'_>) -> Self {
        let rows = model.channels.iter().map(|channel| SensorRow {
            modal: channel.row.iter().map(|c| f64::from(*c)).collect(),
            bias: channel.bias_state.map(usize::from),
            unit: f64::from(channel.unit),
        });
        let first = 2 * usize::from(model.modes);
        Self {
            rows: rows.collect(),
            driving: first..first + model.loads.len(),
            count: 0.0,
            sums: vec![[0.0; 4]; model.channels.len()],
        }
    }

    fn push(&mut self, estimate: &Estimate, state: &[f32], forced: &[f64]) {
        self.count += 1.0;
        for ((sums, row), sensor) in self.sums.iter_mut().zip(&self.rows).zip(&estimate.sensors) {
            if !sensor.fault.is_none() {
                continue;
            }
            // A bias is no displacement.
            let bias = row.bias.map_or(0.0, |bias| f64::from(state[bias]));
            let reading = f64::from(sensor.measured) / row.unit - bias;
            let modal = || row.modal.iter();
            let estimated: f64 = modal().zip(state).map(|(c, x)| c * f64::from(*x)).sum();
            let by_force: f64 = modal().zip(forced).map(|(c, x)| c * x).sum();
            sums[0] += reading;
            sums[1] += reading * reading;
            sums[2] += (reading - estimated).powi(2);
            sums[3] += (reading - by_force).powi(2);
        }
    }

    /// `sum_j 1 - R^2 = sum_j |y - estimate|^2 / |y - mean|^2`.
    fn objectives(&self) -> [f64; 2] {
        [2, 3].map(|of| {
            (self.sums.iter())
                .map(|sums| sums[of] / (sums[1] - sums[0] * sums[0] / self.count))
                .sum()
        })
    }
}
