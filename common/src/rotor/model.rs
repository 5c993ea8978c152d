//! Defines the parameters of a rotor in a model image (`RotorModel`): tables over the speed, read
//! in place (`PackedF32`), noise levels with their steady gains, sensors, encoder. Checks their
//! lengths and ranges before the estimator is built.

use heapless::Vec;
use serde::{Deserialize, Serialize};

use crate::error::{Error, positive};
use crate::io::estimate::MAX_LOADS;
use crate::io::measurement::{AdcScaling, EncoderScaling, IndexPulse};
use crate::io::raw::MAX_CHANNELS;
use crate::load_signal::LoadSignal;
use crate::rotor::filter::{BIASES, FORCES};
use crate::rotor::fixed_lag_smoother::MAX_LAG;

/// Most modal displacements that the model of a rotor can have.
pub const MAX_MODES: usize = 8;

/// Most states that the model of a rotor can have.
pub const MAX_STATES: usize = 24;

/// Most levels of noise that a model can have.
pub const MAX_LEVELS: usize = 4;

/// Most waves a turn that a sensor's runout has.
pub const WAVES: usize = 3;

/// Numbers that stay where the image lies (flash): f32, little endian.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PackedF32<'a> {
    #[serde(borrow)]
    bytes: &'a [u8],
}

impl<'a> PackedF32<'a> {
    /// Numbers over `bytes`, 4 for each.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes }
    }

    /// Number `i`; 0 beyond the end.
    pub fn get(&self, i: usize) -> f32 {
        match self
            .bytes
            .get(4 * i..)
            .and_then(|rest| rest.first_chunk::<4>())
        {
            Some(bytes) => f32::from_le_bytes(*bytes),
            None => 0.0,
        }
    }

    /// Both triangles of a matrix, of its lower one.
    #[inline(never)]
    pub(crate) fn fill<const N: usize>(&self, matrix: &mut [[f32; N]; N]) {
        let mut entry = 0;
        for i in 0..N {
            for j in 0..=i {
                matrix[i][j] = self.get(entry);
                matrix[j][i] = matrix[i][j];
                entry += 1;
            }
        }
    }

    fn check(&self, len: usize, name: &'static str) -> Result<(), Error> {
        if self.bytes.len() != 4 * len {
            return Err(Error::OutOfRange(name));
        }
        if (0..len).all(|i| self.get(i).is_finite()) {
            Ok(())
        } else {
            Err(Error::NotFinite(name))
        }
    }
}

/// The numbers of a rotor in a model image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RotorModel<'a> {
    /// Modal displacements `z`.
    pub modes: u8,
    /// Unit of each state (SI): the filter's state times this is SI.
    pub scale: Vec<f32, MAX_STATES>,
    /// Sample period (s), > 0.
    pub sample_s: f32,
    /// Speeds that the tables hold, evenly spaced.
    pub speeds: SpeedGrid,
    /// Samples by which the estimates lag, at most [`MAX_LAG`].
    pub lag: u8,
    /// For each speed: `D` by rows over modal displacements, their changes and forces.
    #[serde(borrow)]
    pub increment_matrix: PackedF32<'a>,
    /// The bank of noise levels: first that of the description, then larger ones for models that
    /// err more; at least one.
    #[serde(borrow)]
    pub levels: Vec<NoiseModel<'a>, MAX_LEVELS>,
    /// Lower triangle of the covariance before the first sample.
    #[serde(borrow)]
    pub initial_covariance: PackedF32<'a>,
    /// NIS above which a reading is left out, > 0.
    pub gate_nis: f32,
    /// Bit k: load pair k turns with the shaft.
    pub synchronous_mask: u8,
    /// Part of each sensor's bias that is left after a sample, 0 to 1.
    pub bias_decay: [f32; BIASES],
    /// The loads in pairs along x and y.
    pub loads: Vec<LoadSignal, MAX_LOADS>,
    /// Displacement sensors in the order of the raw words.
    pub channels: Vec<RotorChannel, MAX_CHANNELS>,
    /// The shaft's encoder.
    pub encoder: Option<ShaftEncoder>,
    /// The pulse that homes the shaft's angle.
    pub index: Option<IndexPulse>,
}

/// A process noise, and what the filter comes to with it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NoiseModel<'a> {
    /// Lower triangle of Q by rows.
    #[serde(borrow)]
    pub process: PackedF32<'a>,
    /// For each speed: the steady gain `K` by rows, the steady gains of the samples before the
    /// last by rows, the variance of each channel's innovation, the steady standard deviation of
    /// each load after the lag, with the model error that the level allows for, the same where the
    /// speed has not changed since the start, with the model error that white innovations do not show, and the error of
    /// each load under the nominal loads where the model errs by its usual tolerances.
    #[serde(borrow)]
    pub steady: PackedF32<'a>,
    /// Lower triangle of the steady covariance at the machine's speed.
    #[serde(borrow)]
    pub covariance: PackedF32<'a>,
    /// Samples in a row, all sensors used, after which the gain has converged.
    pub full_samples: u32,
    /// Model error that the level allows for, in the usual tolerances; >= 0.
    pub tolerance: f32,
}

/// Speeds of a table.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SpeedGrid {
    /// The first [rad/s], >= 0.
    pub lowest: f32,
    /// From one to the next [rad/s], > 0.
    pub step: f32,
    /// How many, > 0.
    pub count: u16,
    /// The machine's speed where nothing measures it [rad/s].
    pub nominal: f32,
}

/// Numbers of each load in the steady tables: standard deviation, the same where one speed was seen, model error.
const LOAD_TABLES: usize = 3;

/// A displacement sensor in the image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RotorChannel {
    /// Raw word to reading, in `unit`s.
    pub converter: AdcScaling,
    /// Size of the reading's unit (m), > 0.
    pub unit: f32,
    /// Reading of a shaft that rests on its axis.
    pub offset: f32,
    /// What it reads of a surface that is out of true: parts with the cosine and the sine of
    /// the shaft's angle, then of its multiples.
    pub runout: Vec<[f32; 2], WAVES>,
    /// Row over the modal displacements in the filter's scale.
    pub row: Vec<f32, MAX_MODES>,
    /// Variance of the reading, > 0.
    pub variance: f32,
    /// The state that is its bias; behind those of the forces.
    pub bias_state: Option<u8>,
}

/// The shaft's encoder in the image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ShaftEncoder {
    /// Count to shaft angle.
    pub counter: EncoderScaling,
    /// Part of an angle error that the tracked angle takes in a sample, 0 to 1.
    pub angle_gain: f32,
    /// Part of it that the tracked speed takes [1/s], > 0.
    pub speed_gain: f32,
    /// Part of it that the tracked acceleration takes [1/s^2], > 0.
    pub acceleration_gain: f32,
}

impl RotorChannel {
    /// Reading of a shaft on its axis, with `waves` the cosine and the sine of its angle and
    /// of the multiples.
    ///
    /// `offset + sum_k a_k cos(k angle) + b_k sin(k angle)`
    pub(crate) fn zero(&self, waves: &[[f32; 2]; WAVES]) -> f32 {
        let mut zero = self.offset;
        for ([a, b], [cosine, sine]) in self.runout.iter().zip(waves) {
            zero += a * cosine + b * sine;
        }
        zero
    }
}

impl RotorModel<'_> {
    /// Numbers of `D` at one speed.
    pub fn dense_stride(&self) -> usize {
        let nz = usize::from(self.modes);
        nz * (2 * nz + FORCES)
    }

    /// Numbers of one speed in the steady tables.
    pub fn steady_stride(&self) -> usize {
        let (nx, ny) = (self.scale.len(), self.channels.len());
        (1 + usize::from(self.lag)) * nx * ny + ny + LOAD_TABLES * self.loads.len()
    }

    /// Checks every length and range for `modes` modes and `states` states.
    pub(crate) fn check(&self, modes: usize, states: usize) -> Result<(), Error> {
        if usize::from(self.modes) != modes || self.scale.len() != states {
            return Err(Error::OutOfRange("number of states"));
        }
        positive(self.scale.iter().copied(), "scale")?;
        let speeds = &self.speeds;
        positive([self.sample_s], "sample_s")?;
        if usize::from(self.lag) > MAX_LAG {
            return Err(Error::OutOfRange("lag"));
        }
        positive([speeds.step, speeds.nominal], "speeds")?;
        if !(speeds.lowest >= 0.0 && speeds.lowest.is_finite()) || speeds.count == 0 {
            return Err(Error::OutOfRange("speeds"));
        }
        self.increment_matrix.check(
            usize::from(speeds.count) * self.dense_stride(),
            "increment_matrix",
        )?;
        let (ny, nd) = (self.channels.len(), self.loads.len());
        checked_covariance(&self.initial_covariance, states, "initial_covariance")?;
        self.check_levels(states)?;
        positive([self.gate_nis], "gate_nis")?;
        if nd == 0 || !nd.is_multiple_of(2) || nd > FORCES {
            return Err(Error::OutOfRange("loads"));
        }
        for load in &self.loads {
            positive([load.full_scale, load.valid_std], "load")?;
        }
        if ny == 0 {
            return Err(Error::OutOfRange("channels"));
        }
        self.check_channels(modes, states)?;
        if let Some(encoder) = &self.encoder {
            if !(1..=32).contains(&encoder.counter.bits) {
                return Err(Error::OutOfRange("encoder bits"));
            }
            let gains = [
                encoder.angle_gain,
                encoder.speed_gain,
                encoder.acceleration_gain,
            ];
            positive(gains, "encoder gain")?;
        }
        self.index.as_ref().map_or(Ok(()), IndexPulse::check)
    }

    /// Checks the noise levels with their steady tables.
    fn check_levels(&self, states: usize) -> Result<(), Error> {
        let (ny, nd) = (self.channels.len(), self.loads.len());
        let speeds = usize::from(self.speeds.count);
        let stride = self.steady_stride();
        if self.levels.is_empty() {
            return Err(Error::OutOfRange("levels"));
        }
        for noise in &self.levels {
            checked_covariance(&noise.process, states, "process")?;
            checked_covariance(&noise.covariance, states, "covariance")?;
            noise.steady.check(speeds * stride, "steady")?;
            for k in 0..speeds {
                let end = (k + 1) * stride - LOAD_TABLES * nd;
                positive(
                    (end - ny..end).map(|i| noise.steady.get(i)),
                    "innovation variance",
                )?;
            }
            if !(noise.tolerance >= 0.0 && noise.tolerance.is_finite()) {
                return Err(Error::OutOfRange("tolerance"));
            }
        }
        Ok(())
    }

    /// Checks the channels and the decay of their biases.
    fn check_channels(&self, modes: usize, states: usize) -> Result<(), Error> {
        if !self
            .bias_decay
            .iter()
            .all(|bias_decay| (0.0..=1.0).contains(bias_decay))
        {
            return Err(Error::OutOfRange("bias_decay"));
        }
        let biases = 2 * modes + FORCES..states;
        for channel in &self.channels {
            positive([channel.unit, channel.variance], "channel")?;
            let gain = channel.converter.gain;
            if !(gain.is_finite() && gain != 0.0 && channel.offset.is_finite()) {
                return Err(Error::OutOfRange("channel gain"));
            }
            if !channel.runout.iter().flatten().all(|part| part.is_finite()) {
                return Err(Error::NotFinite("channel runout"));
            }
            if channel.row.len() != modes || !channel.row.iter().all(|c| c.is_finite()) {
                return Err(Error::OutOfRange("channel row"));
            }
            if (channel.bias_state).is_some_and(|bias| !biases.contains(&usize::from(bias))) {
                return Err(Error::OutOfRange("channel bias"));
            }
        }
        Ok(())
    }
}

/// Checks the length of a packed covariance of `states` states, and that no variance is negative.
fn checked_covariance(m: &PackedF32<'_>, states: usize, name: &'static str) -> Result<(), Error> {
    m.check(states * (states + 1) / 2, name)?;
    if (0..states).any(|i| m.get(i * (i + 3) / 2) < 0.0) {
        return Err(Error::NotPositive(name));
    }
    Ok(())
}
