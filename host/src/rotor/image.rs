//! From the machine description to the rotor of the image.

use faer::{Mat, c64};
use heapless::Vec as FixedVec;
use loadtwin_common::image::{LoadSignal, Model};
use loadtwin_common::line::ROTOR_SIZES;
use loadtwin_common::measurement::{Converter, Counter, IndexPulse};
use loadtwin_common::phase::{Phase, PhaseStep};
use loadtwin_common::rotor::filter::Turn;
use loadtwin_common::rotor::{
    Numbers, RotorChannel, RotorModel as ImageModel, ShaftEncoder, Speeds,
};

use super::RotorError;
use super::convergence::{Recursion, triangle};
use super::discrete::{Discrete, discrete, held, moved, turned};
use super::model::{BAND, RotorModel};
use super::reduction::{Reduced, ReductionError};
use super::unbalance::{Unbalance, unbalance_response};
use crate::build::{self, BuildError, Sensors};
use crate::machine::{Channel, Encoder, LoadKind, Machine, Rotor, Senses};
use crate::riccati::{gain, steady_covariance};

/// Speeds of the tables where the machine has a range of them.
const SPEEDS: usize = 17;

/// Readings are in micrometres.
const UNIT_M: f64 = 1e-6;

/// Load at the end of the scale on the bus, in nominal loads.
const FULL_SCALE: f64 = 16.0;

/// Standard deviation at which an estimate is no longer valid, in nominal loads.
const VALID_STD: f64 = 1.0;

/// Bandwidth of the tracked speed, in sample rates, at most [Hz].
const TRACKING: f64 = 0.01;
const TRACKING_HZ: f64 = 20.0;

/// Everything that the image of a rotor is made of.
pub struct RotorPlan {
    model: RotorModel,
    reduced: Reduced,
    /// Modal displacements and states of the filter.
    size: (usize, usize),
    scale: Vec<f64>,
    dt_s: f64,
    speeds: Vec<f64>,
    nominal_speed: f64,
    forces: Vec<Vec<f64>>,
    turning: Vec<bool>,
    nominal: Vec<f64>,
}

impl RotorPlan {
    /// Assembles and reduces `rotor`.
    ///
    /// # Errors
    /// When it is not held, or is larger than an image.
    pub fn new(machine: &Machine, rotor: &Rotor) -> Result<Self, BuildError> {
        let model = RotorModel::new(rotor);
        let forces: Vec<Vec<f64>> = (rotor.loads.iter())
            .flat_map(|load| {
                [0.0, std::f64::consts::FRAC_PI_2].map(|a| model.direction(load.node, a))
            })
            .collect();
        let wanted = rotor.reduction.modes.map(|modes| modes + forces.len());
        let [.., most] = ROTOR_SIZES;
        let size = (ROTOR_SIZES.into_iter())
            .find(|(nz, nx)| nx - 2 * nz >= forces.len() && *nz >= wanted.unwrap_or(*nz))
            .ok_or(BuildError::TooManyModes {
                found: rotor.reduction.modes.unwrap_or(2),
                most: most.0 - forces.len(),
                loads: rotor.loads.len(),
            })?;
        let kept = rotor.reduction.modes.unwrap_or(size.0 - forces.len());
        let [low, high] = rotor.schedule();
        let count = if high > low { SPEEDS } else { 1 };
        let speeds = (0..count)
            .map(|k| low + (high - low) * k as f64 / (count.max(2) - 1) as f64)
            .collect::<Vec<f64>>();
        let reduced = Reduced::new(&model, rotor.speed_rad_s, &speeds, kept, &forces)?;
        let mut plan = Self {
            model,
            reduced,
            size,
            scale: Vec::new(),
            dt_s: 1.0 / machine.rate_hz,
            speeds,
            nominal_speed: rotor.speed_rad_s,
            turning: rotor
                .loads
                .iter()
                .map(|l| l.kind == LoadKind::Unbalance)
                .collect(),
            nominal: rotor.loads.iter().flat_map(|l| [l.nominal_n; 2]).collect(),
            forces,
        };
        plan.scale = plan.scales()?;
        Ok(plan)
    }

    /// Bit k: pair k turns with the shaft.
    fn turning_bits(&self) -> u8 {
        (self.turning.iter().enumerate())
            .map(|(k, turns)| u8::from(*turns) << k)
            .sum()
    }

    /// Modal displacements kept.
    fn modes(&self) -> usize {
        self.reduced.len()
    }

    /// Amplitude of each state under the nominal loads; 1 for a state that nothing depends on.
    fn scales(&self) -> Result<Vec<f64>, BuildError> {
        let (nz, nx) = self.size;
        let mut scale = vec![1.0_f64; nx];
        for i in 0..self.modes() {
            scale[i] = 1e-12;
        }
        for speed in self.speeds.iter().chain([&self.nominal_speed]) {
            for pair in 0..self.turning.len() {
                let growth = if self.turning[pair] {
                    (speed / self.nominal_speed).powi(2)
                } else {
                    1.0
                };
                let force = self.phasor(pair, growth * self.nominal[2 * pair]);
                let q = self.reduced.response(&self.model, *speed, &force)?;
                let mq = Mat::from_fn(q.len(), 1, |i, _| {
                    let row = i.saturating_sub(BAND)..q.len().min(i + BAND + 1);
                    row.map(|j| q[j] * self.model.mass[(i, j)]).sum::<c64>()
                });
                for i in 0..self.modes() {
                    let z: c64 = (0..q.len())
                        .map(|j| mq[(j, 0)] * self.reduced.basis[(j, i)])
                        .sum();
                    scale[i] = scale[i].max(z.re.hypot(z.im));
                }
            }
        }
        // The change in a sample is added to the displacement: in its unit.
        scale.copy_within(0..nz, nz);
        for (j, nominal) in self.nominal.iter().enumerate() {
            scale[2 * nz + j] = *nominal;
        }
        Ok(scale)
    }

    /// A force of `size` [N] that turns with the shaft at the node of a pair.
    fn phasor(&self, pair: usize, size: f64) -> Vec<c64> {
        (self.forces[2 * pair].iter().zip(&self.forces[2 * pair + 1]))
            .map(|(x, y)| c64::new(size * x, -size * y))
            .collect()
    }

    /// Where reduced state `i` of `2 modes + loads` stands in the filter.
    fn place(&self, i: usize) -> usize {
        let (modes, nz) = (self.modes(), self.size.0);
        match i {
            _ if i < modes => i,
            _ if i < 2 * modes => nz + i - modes,
            _ => 2 * nz + i - 2 * modes,
        }
    }

    fn discrete(&self, speed: f64) -> Result<Discrete, BuildError> {
        let held = held(
            &self.model,
            &self.reduced,
            speed,
            &self.forces,
            &self.turning,
            self.dt_s,
        );
        discrete(&held, &moved(&self.turning, speed * self.dt_s)).ok_or(BuildError::Sampled)
    }

    /// A matrix over the reduced states, in the scale and the places of the filter:
    /// `m_ij s_j / s_i`, or `m_ij / (s_i s_j)` for a covariance.
    fn scaled(&self, m: &Mat<f64>, covariance: bool) -> Mat<f64> {
        let nx = self.size.1;
        let mut scaled = Mat::<f64>::zeros(nx, nx);
        for i in 0..m.nrows() {
            for j in 0..m.ncols() {
                let (a, b) = (self.place(i), self.place(j));
                let (si, sj) = (self.scale[a], self.scale[b]);
                let factor = if covariance { 1.0 / (si * sj) } else { sj / si };
                scaled[(a, b)] = m[(i, j)] * factor;
            }
        }
        scaled
    }

    /// Row of a displacement sensor over the states of the filter [`UNIT_M`].
    fn row(&self, channel: &Channel) -> Vec<f64> {
        let mut row = vec![0.0; self.size.1];
        if let Senses::Displacement(at) = &channel.senses {
            let direction = self.model.direction(at.node, at.direction_deg.to_radians());
            for (i, value) in self.reduced.row(&direction).iter().enumerate() {
                row[i] = channel.sensitivity.unwrap_or(1.0) * value * self.scale[i] / UNIT_M;
            }
        }
        row
    }

    /// Displacements along x and y of every node [m], node by node, of the
    /// filter's state in the image's scale.
    pub fn displacements(&self, state: &[f32], into: &mut [f64]) {
        let basis = &self.reduced.basis;
        for (k, slot) in into.iter_mut().enumerate() {
            let row = 4 * (k / 2) + k % 2;
            *slot = (0..self.modes().min(state.len()))
                .map(|i| basis[(row, i)] * self.scale[i] * f64::from(state[i]))
                .sum();
        }
    }

    /// Number of nodes.
    pub fn nodes(&self) -> usize {
        self.model.nodes
    }

    /// What the reduction loses of the response to nominal loads over the speeds.
    ///
    /// # Errors
    /// [`RotorError::Resonance`] for an undamped rotor at its critical speed.
    pub fn reduction_error(&self, rotor: &Rotor) -> Result<ReductionError, RotorError> {
        let mut error = ReductionError::default();
        let mut speeds = self.speeds.clone();
        speeds.push(self.nominal_speed);
        for speed in speeds.into_iter().filter(|speed| *speed > 0.0) {
            for (pair, load) in rotor.loads.iter().enumerate() {
                let growth = (speed / self.nominal_speed).powi(2);
                let unbalance = Unbalance {
                    node: load.node,
                    moment_kg_m: load.nominal_n / self.nominal_speed.powi(2),
                    phase_rad: 0.0,
                };
                let whole = unbalance_response(&self.model, speed, &[unbalance])?;
                let force = self.phasor(pair, growth * load.nominal_n);
                let reduced = self.reduced.response(&self.model, speed, &force)?;
                error.push(speed, &whole, &reduced);
            }
        }
        Ok(error)
    }

    /// Q and the covariance before the first sample, in the scale of the filter.
    fn covariances(&self, rotor: &Rotor, discrete: &Discrete) -> (Mat<f64>, Mat<f64>) {
        let modes = self.modes();
        let k = self.reduced.stiffness(&self.model, self.nominal_speed);
        let n = 2 * modes + self.nominal.len();
        let (mut q, mut p) = (Mat::<f64>::zeros(n, n), Mat::<f64>::zeros(n, n));
        for i in 0..modes {
            let (z, w2) = (self.scale[i].powi(2), k[(i, i)]);
            let (model, start) = (
                rotor.reduction.model_std.powi(2),
                rotor.reduction.initial_std.powi(2),
            );
            q[(i, i)] = model * z;
            q[(modes + i, modes + i)] = model * z * w2;
            p[(i, i)] = start * z;
            p[(modes + i, modes + i)] = start * z * w2;
        }
        for (j, nominal) in self.nominal.iter().enumerate() {
            let walk = rotor.loads[j / 2].walk(self.nominal_speed);
            q[(2 * modes + j, 2 * modes + j)] = walk * walk * self.dt_s;
            p[(2 * modes + j, 2 * modes + j)] = nominal * nominal;
        }
        let t = &discrete.coordinates;
        (
            self.scaled(&turned(t, &q), true),
            self.scaled(&turned(t, &p), true),
        )
    }

    /// The transition at the machine's speed, in the scale of the filter.
    ///
    /// # Errors
    /// [`BuildError::Sampled`] where a mode is sampled at a multiple of half its period.
    pub fn transition(&self) -> Result<Mat<f64>, BuildError> {
        let nominal = self.discrete(self.nominal_speed)?;
        Ok(self.scaled(&nominal.transition, false))
    }

    /// Q and the covariance before the first sample as the image has them, with the noise of
    /// `rotor`.
    ///
    /// # Errors
    /// As [`RotorPlan::transition`].
    pub fn noise(&self, rotor: &Rotor) -> Result<[Vec<u8>; 2], BuildError> {
        let (q, p) = self.covariances(rotor, &self.discrete(self.nominal_speed)?);
        Ok([&q, &p].map(|m| bytes(triangle(m))))
    }

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
        let (nz, nx) = self.size;
        let rows: Vec<Vec<f64>> = sensors.channels.iter().map(|c| self.row(c)).collect();
        let h = Mat::from_fn(rows.len(), nx, |i, j| rows[i][j]);
        let variances: Vec<f64> = (sensors.channels.iter())
            .map(|c| (c.to_si(c.noise_std) / UNIT_M).powi(2))
            .collect();
        let nominal = self.discrete(self.nominal_speed)?;
        let (q, p) = self.covariances(rotor, &nominal);
        let tables = self.tables(&h, &q, &variances)?;
        let f = self.scaled(&nominal.transition, false);
        let angle = self.nominal_speed * self.dt_s;
        let recursion = Recursion {
            f: &f,
            rows: &rows,
            variances: &variances,
            q: &q,
            p: &p,
            turn: Turn {
                turning: self.turning_bits(),
                pairs: self.turning.len(),
                cosine: angle.cos(),
                sine: angle.sin(),
            },
            dt_s: self.dt_s,
        };
        let full_samples = recursion.converged_after(self.size);
        let (tables, q, p) = (bytes(tables), bytes(triangle(&q)), bytes(triangle(&p)));
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
            speeds: Speeds {
                lowest: self.speeds[0] as f32,
                step: step as f32,
                count: self.speeds.len() as u16,
                nominal: self.nominal_speed as f32,
            },
            tables: Numbers::new(&tables),
            process_noise: Numbers::new(&q),
            initial_covariance: Numbers::new(&p),
            full_samples,
            gate_nis: machine.tuning.gate_nis as f32,
            turning: self.turning_bits(),
            loads: Self::loads(rotor)?,
            channels: (sensors.channels.iter().zip(&rows).zip(&variances))
                .map(|((channel, row), variance)| self.channel(channel, row, *variance))
                .collect::<Result<_, _>>()?,
            encoder,
            index: index.map(|index| IndexPulse {
                encoder: 0,
                angle: phase(index.angle_rad),
                tolerance_rad: index.tolerance_rad as f32,
            }),
        };
        build::packed(machine, Model::Rotor(model))
    }

    /// For each speed of the schedule: the part of `F` that varies, the steady gain, the
    /// variances of the innovations, and the standard deviations of the loads.
    fn tables(
        &self,
        h: &Mat<f64>,
        q: &Mat<f64>,
        variances: &[f64],
    ) -> Result<Vec<f64>, BuildError> {
        let (nz, nx) = self.size;
        let mut tables = Vec::new();
        for speed in &self.speeds {
            let discrete = self.discrete(*speed)?;
            let f = self.scaled(&discrete.transition, false);
            let steady = steady_covariance(&f, h, q, variances).ok_or(BuildError::NotObserved)?;
            let k = gain(&steady, h, variances);
            tables.extend(
                (0..nz)
                    .flat_map(|i| (0..nx).map(move |j| (nz + i, j)))
                    .map(|at| f[at]),
            );
            tables.extend(
                (0..nx)
                    .flat_map(|i| (0..variances.len()).map(move |j| (i, j)))
                    .map(|at| k[at]),
            );
            let hp = h * &steady;
            tables.extend(
                (0..variances.len())
                    .map(|i| variances[i] + (0..nx).map(|j| hp[(i, j)] * h[(i, j)]).sum::<f64>()),
            );
            let posterior = &steady - &k * &hp;
            let d = 2 * nz..2 * nz + self.nominal.len();
            tables.extend(d.map(|d| posterior[(d, d)].max(0.0).sqrt()));
        }
        Ok(tables)
    }

    fn shaft_encoder(&self, encoder: &Encoder, rate_hz: f64) -> ShaftEncoder {
        let bandwidth = (TRACKING * rate_hz).min(TRACKING_HZ);
        let rest = (-std::f64::consts::TAU * bandwidth * self.dt_s).exp();
        ShaftEncoder {
            counter: Counter {
                step: phase_step(1.0 / encoder.counts_per_turn),
                bits: encoder.bits as u8,
            },
            angle_gain: (1.0 - rest * rest) as f32,
            speed_gain: ((1.0 - rest).powi(2) / self.dt_s) as f32,
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
        let extreme = 1_i64 << (channel.adc.bits - 1);
        Ok(RotorChannel {
            converter: Converter {
                zero: channel.zero_word(),
                gain: (channel.lsb_si() / UNIT_M) as f32,
                lowest: (-extreme) as i32,
                highest: (extreme - 1) as i32,
                stuck_after: channel.adc.stuck_after,
            },
            unit: UNIT_M as f32,
            offset: (channel.to_si(channel.offset) / UNIT_M) as f32,
            row: fixed(&row[..self.size.0])?,
            variance: variance as f32,
        })
    }
}

fn bytes(values: Vec<f64>) -> Vec<u8> {
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

fn phase(rad: f64) -> Phase {
    let turns = rad / std::f64::consts::TAU;
    phase_step(turns - turns.floor()).into_phase()
}

fn phase_step(turns: f64) -> PhaseStep {
    PhaseStep((turns * 18_446_744_073_709_551_616.0) as i128 as u64)
}
