//! Builds the payload of a rotor's model image from its filter design: transitions over the grid of
//! speeds, channels, shaft encoder, and for each noise level and speed the steady gains and
//! standard deviations of the loads, by the Riccati equation.

use faer::Mat;
use heapless::Vec as FixedVec;
use loadtwin_common::image::Model;
use loadtwin_common::io::measurement::AdcScaling;
use loadtwin_common::load_signal::LoadSignal;
use loadtwin_common::rotor::filter::{FORCES, LoadTransition};
use loadtwin_common::rotor::mismatch::PASSED;
use loadtwin_common::rotor::{
    NoiseModel, PackedF32, RotorChannel, RotorModel as ImageModel, ShaftEncoder, SpeedGrid,
};

use crate::encoder_scaling;
use crate::error::BuildError;
use crate::payload::packed;
use crate::rotor::filter_design::{RotorFilterDesign, UNIT_M};
use crate::rotor::gain_convergence::{CovarianceRecursion, changes, triangle};
use crate::rotor::modal_truncation::ModalModel;
use crate::rotor::tolerance_covariance::{ModelErrors, SteadyFilter};
use crate::sensor_set::Sensors;
use loadtwin_machine::{Channel, Encoder, Machine, QUANTISATION, Rotor, extreme_words};
use loadtwin_math::riccati::{gain, gains_before, innovation_covariance, steady_covariance};

/// Load at the end of the scale on the bus, in nominal loads: faults multiply an unbalance. A step
/// is 1.2e-4 nominal.
const FULL_SCALE: f64 = 16.0;

/// Standard deviation at which an estimate is no longer valid, in nominal loads: as large as the
/// load.
const VALID_STD: f64 = 1.0;

/// Largest bandwidth of the tracked speed, over the sample rate.
const TRACKING: f64 = 0.01;

/// Largest bandwidth of the tracked speed [Hz]; less by the cube root where the angle is noisier
/// than [`TRACKED_TURNS`].
const TRACKING_HZ: f64 = 20.0;

/// Noise of the angle up to which that bandwidth is used [turns]: rounding of 4096 counts a turn.
const TRACKED_TURNS: f64 = QUANTISATION / 4096.0;

impl RotorFilterDesign {
    /// The image's payload, as postcard bytes.
    ///
    /// # Errors
    /// When there is no steady filter, or a sensor set that an image cannot hold.
    pub fn image(
        &self,
        machine: &Machine,
        rotor: &Rotor,
        sensors: &Sensors,
    ) -> Result<Vec<u8>, BuildError> {
        let nz = self.size.0;
        let rows: Vec<Vec<f64>> = sensors.channels.iter().map(|c| self.row(c)).collect();
        let biases: Vec<Option<usize>> = (sensors.channels.iter())
            .map(|c| self.bias_state(c))
            .collect();
        let (h, variances) = self.observation(&sensors.channels);
        let nominal = self.discrete(self.nominal_rotor())?;
        let f = self.transition_of(&nominal);
        let (_, p) = self.covariances(rotor, &nominal);
        let angle = self.nominal_speed * self.dt_s;
        let noise = |(rotor, tolerance): &(Rotor, f64)| -> Result<PackedNoise, BuildError> {
            let (q, _) = self.covariances(rotor, &nominal);
            let recursion = CovarianceRecursion {
                f: &f,
                rows: &rows,
                biases: &biases,
                variances: &variances,
                q: &q,
                p: &p,
                turn: LoadTransition {
                    synchronous_mask: self.turning_bits(),
                    pairs: self.turning.len(),
                    cos_minus_one: angle.cos() - 1.0,
                    sin: angle.sin(),
                    bias_decay: self.left(),
                },
                dt_s: self.dt_s,
            };
            let covariance = posterior(&f, &h, &q, &variances)?;
            Ok(PackedNoise {
                process: bytes(triangle(&q)),
                steady: bytes(self.steady(rotor, *tolerance, &h, &q, &variances)?),
                covariance: bytes(triangle(&covariance)),
                full_samples: recursion.converged_after(self.size),
                tolerance: *tolerance as f32,
            })
        };
        let levels: Vec<PackedNoise> = (rotor.levels().iter())
            .map(noise)
            .collect::<Result<_, _>>()?;
        let (dense, p) = (bytes(self.dense()?), bytes(triangle(&p)));
        let encoder = (sensors.encoders.first()).map(|e| self.shaft_encoder(e, machine.rate_hz));
        let index = machine.index.as_ref().filter(|_| encoder.is_some());
        let step = match self.speeds.as_slice() {
            [a, b, ..] => b - a,
            _ => 1.0,
        };
        let model = ImageModel {
            modes: nz as u8,
            scale: fixed(&self.scale)?,
            sample_s: self.dt_s as f32,
            speeds: SpeedGrid {
                lowest: self.speeds[0] as f32,
                step: step as f32,
                count: self.speeds.len() as u16,
                nominal: self.nominal_speed as f32,
            },
            lag: rotor.lag(),
            increment_matrix: PackedF32::new(&dense),
            levels: levels.iter().map(PackedNoise::view).collect(),
            initial_covariance: PackedF32::new(&p),
            gate_nis: machine.tuning.gate_nis as f32,
            synchronous_mask: self.turning_bits(),
            bias_decay: self.left().map(|left| left as f32),
            loads: Self::loads(rotor)?,
            channels: (sensors.channels.iter().zip(&rows).zip(&variances))
                .map(|((channel, row), variance)| self.channel(channel, row, *variance))
                .collect::<Result<_, _>>()?,
            encoder,
            index: index.map(|index| encoder_scaling::pulse(index, 0, sensors.encoders.first())),
        };
        packed(machine, &sensors.channels, Model::Rotor(model))
    }

    /// For each speed of the schedule: the part of `F` that varies.
    fn dense(&self) -> Result<Vec<f64>, BuildError> {
        let nz = self.size.0;
        let mut dense = Vec::new();
        for rotor in self.rotors() {
            let f = self.transition_of(&self.discrete(rotor)?);
            dense.extend(
                (0..nz)
                    .flat_map(|i| (0..2 * nz + FORCES).map(move |j| (i, j)))
                    .map(|(i, j)| changes(&f, nz, i, j)),
            );
        }
        Ok(dense)
    }

    /// For each speed of the schedule: the steady gain and those of the samples before, the
    /// variances of the innovations, and of each load the standard deviation, the same where the
    /// speed has not changed, and the error where the rotor is off by the usual tolerances.
    fn steady(
        &self,
        rotor: &Rotor,
        tolerance: f64,
        h: &Mat<f64>,
        q: &Mat<f64>,
        variances: &[f64],
    ) -> Result<Vec<f64>, BuildError> {
        let (nz, nx) = self.size;
        let mut tables = Vec::new();
        for at in self.rotors() {
            let steady = self.steady_at(rotor, at, h, q, variances)?;
            for gain in &steady.gains {
                tables.extend(
                    (0..nx)
                        .flat_map(|i| (0..variances.len()).map(move |j| (i, j)))
                        .map(|at| gain[at]),
                );
            }
            tables.extend(steady.innovations);
            let loads = || 2 * nz..2 * nz + self.nominal.len();
            let error = |d: usize| steady.errors.usual[(d, d)].max(0.0);
            let own = |d: usize| steady.covariance[(d, d)].max(0.0);
            let unseen = |d: usize| steady.errors.unseen[(d, d)].max(0.0);
            let allowed = |d: usize| tolerance * tolerance * error(d);
            tables.extend(loads().map(|d| (own(d) + allowed(d)).sqrt()));
            tables.extend(loads().map(|d| (own(d) + allowed(d).max(unseen(d))).sqrt()));
            tables.extend(loads().map(|d| error(d).sqrt()));
        }
        Ok(tables)
    }

    /// Steady state of the filter at one speed, with process noise `q`.
    pub(super) fn steady_at(
        &self,
        rotor: &Rotor,
        at: &ModalModel,
        h: &Mat<f64>,
        q: &Mat<f64>,
        variances: &[f64],
    ) -> Result<SteadyState, BuildError> {
        let f = self.transition_of(&self.discrete(at)?);
        let prior = steady_covariance(&f, h, q, variances).ok_or(BuildError::NotObserved)?;
        let k = gain(&prior, h, variances);
        let before = gains_before(&f, h, &prior, &k, variances, rotor.lag().into());
        let hp = h * &prior;
        let s = innovation_covariance(&hp, h, variances);
        let innovations: Vec<f64> = (0..variances.len()).map(|i| s[(i, i)]).collect();
        let passed: Vec<f64> = (innovations.iter())
            .map(|s| f64::from(PASSED) * s)
            .collect();
        let filter = SteadyFilter { f: &f, h, k: &k };
        let errors = self.model_errors(rotor, at, &filter, &passed);
        let (mut gains, mut covariance) = (vec![k.clone()], &prior - &k * &hp);
        for (gain, reduction) in before {
            gains.push(gain);
            covariance -= reduction;
        }
        Ok(SteadyState {
            gains,
            innovations,
            covariance,
            errors,
        })
    }

    /// Gains of a filter of which every pole is `rest`; slower where the encoder is coarse, by
    /// the cube root, as the best one for accelerations that change alike would be.
    ///
    /// Source: Brookner, Tracking and Kalman Filtering Made Easy (1998), section 1.4,
    /// critically damped g-h-k filter; Kalata 1984, tracking index.
    fn shaft_encoder(&self, encoder: &Encoder, rate_hz: f64) -> ShaftEncoder {
        let turns = encoder.noise_std_counts() / encoder.counts_per_turn.abs();
        let coarse = (TRACKED_TURNS / turns).min(1.0).cbrt();
        let bandwidth = (TRACKING * rate_hz).min(TRACKING_HZ * coarse);
        let rest = (-std::f64::consts::TAU * bandwidth * self.dt_s).exp();
        let (gone, dt) = (1.0 - rest, self.dt_s);
        ShaftEncoder {
            counter: encoder_scaling::counter(encoder, 1.0),
            angle_gain: (1.0 - rest.powi(3)) as f32,
            speed_gain: (1.5 * gone * gone * (1.0 + rest) / dt) as f32,
            acceleration_gain: (gone.powi(3) / (dt * dt)) as f32,
        }
    }

    fn loads<const N: usize>(rotor: &Rotor) -> Result<FixedVec<LoadSignal, N>, BuildError> {
        (rotor.loads.iter())
            .flat_map(|load| load.names.iter().map(move |name| (name, load.nominal_n)))
            .map(|(name, nominal)| {
                Ok(LoadSignal {
                    name: (name.as_str().try_into())
                        .map_err(|_| BuildError::TooLarge("a load's name"))?,
                    full_scale: (FULL_SCALE * nominal) as f32,
                    valid_std: (VALID_STD * nominal) as f32,
                })
            })
            .collect()
    }

    fn channel(
        &self,
        channel: &Channel,
        row: &[f64],
        variance: f64,
    ) -> Result<RotorChannel, BuildError> {
        let [lowest, highest] = extreme_words(channel.converter().bits);
        Ok(RotorChannel {
            converter: AdcScaling {
                zero: channel.zero_word(),
                gain: (channel.lsb_si() / UNIT_M) as f32,
                lowest,
                highest,
                stuck_after: channel.stuck_after(),
            },
            unit: UNIT_M as f32,
            offset: (channel.to_si(channel.offset) / UNIT_M) as f32,
            runout: (channel.runout.iter())
                .map(|wave| wave.map(|part| (channel.to_si(part) / UNIT_M) as f32))
                .collect(),
            row: fixed(&row[..self.size.0])?,
            variance: variance as f32,
            bias_state: self.bias_state(channel).map(|state| state as u8),
        })
    }
}

/// Steady states of the filter with one process noise, as stored in an image.
struct PackedNoise {
    process: Vec<u8>,
    steady: Vec<u8>,
    covariance: Vec<u8>,
    full_samples: u32,
    tolerance: f32,
}

/// Steady state of a filter at one speed.
pub(super) struct SteadyState {
    /// Gain of the last sample, then of those before it.
    pub gains: Vec<Mat<f64>>,
    /// Variances of the innovations.
    pub innovations: Vec<f64>,
    /// Covariance after the update and the lag.
    pub covariance: Mat<f64>,
    /// Of the tolerances.
    pub errors: ModelErrors,
}

impl PackedNoise {
    fn view(&self) -> NoiseModel<'_> {
        NoiseModel {
            process: PackedF32::new(&self.process),
            steady: PackedF32::new(&self.steady),
            covariance: PackedF32::new(&self.covariance),
            full_samples: self.full_samples,
            tolerance: self.tolerance,
        }
    }
}

/// Covariance to which the filter converges, after the update.
fn posterior(
    f: &Mat<f64>,
    h: &Mat<f64>,
    q: &Mat<f64>,
    variances: &[f64],
) -> Result<Mat<f64>, BuildError> {
    let prior = steady_covariance(f, h, q, variances).ok_or(BuildError::NotObserved)?;
    let k = gain(&prior, h, variances);
    Ok(&prior - &k * h * &prior)
}

/// Numbers as they lie in an image.
pub(crate) fn bytes(values: Vec<f64>) -> Vec<u8> {
    (values.into_iter())
        .flat_map(|value| (value as f32).to_le_bytes())
        .collect()
}

fn fixed<const N: usize>(values: &[f64]) -> Result<FixedVec<f32, N>, BuildError> {
    let mut fixed = FixedVec::new();
    for value in values {
        (fixed.push(*value as f32)).map_err(|_| BuildError::TooLarge("the number of states"))?;
    }
    Ok(fixed)
}
