//! Estimates the loads of a gearbox from strain gauges and encoders, one raw sample at a time
//! (`DrivetrainEstimator::step_into`), by an augmented Kalman filter of its torsional drivetrain. A
//! gauge reads torque times a strain map, periodic in the carrier angle.
//!
//! States: carrier angle `theta` (rad), twists of the shafts, speeds of the
//! inertias, biases, and last the two loads; all but `theta` in the image's scale.
//!
//! `x+ = F x + B u + w`, `y_i = o_i + m_i(theta) (c_i x) + b_i + v_i`
//!
//! `F` is exact for the linear part; `c_i x` is what channel i senses (the torque
//! of a shaft, a load, a speed), `m_i` its sensitivity over the carrier angle.
//!
//! Source: Bosmans et al. 2023, section 4.1, eq. (1), (6)-(14).

mod carrier_angle;
mod error_band;
mod fault_isolation;
mod fault_kind;
mod friction;
mod gauge_response;
mod gauges;
mod model;
mod process_noise;
mod steady_gain;

use crate::drivetrain::carrier_angle::{Track, rotate};
use crate::drivetrain::error_band::Movement;
use heapless::Vec;
use nalgebra::{RowSVector, SVector};
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::io::estimate::{Estimate, LoadEstimate, MAX_SENSORS, SensorEstimate};
use crate::io::fault::Fault;
use crate::io::measurement::{AdcScaling, EncoderScaling, Measurement, SignalConditioner};
use crate::io::raw::{MAX_CHANNELS, MAX_ENCODERS, RawSample};
use crate::kalman::gaussian::Gaussian;
use crate::kalman::innovation::{Gate, Innovation, Outcome};
use crate::kalman::transition::{ProcessNoise, RandomWalk, Transition};
use crate::load_signal::{LoadSignal, MAX_STATES, StateVec};
use crate::signal::phase::wrap_rad;
use crate::signal::trigonometry;

pub use crate::drivetrain::error_band::ErrorBand;
pub use crate::drivetrain::fault_isolation::Consistency;
use crate::drivetrain::fault_isolation::{Direction, FaultIsolation, Isolation};
pub use crate::drivetrain::friction::{Friction, MAX_FRICTIONS};
pub use crate::drivetrain::gauge_response::GaugeResponse;
use crate::drivetrain::gauge_response::HysteresisState;
pub use crate::drivetrain::model::{Bias, Channel, Encoder, GearboxModel, LOADS, Role};
use crate::drivetrain::process_noise::noise;
pub use crate::drivetrain::steady_gain::SteadyGains;

/// Samples after which a gap is a new start.
const LONGEST_GAP: u32 = 100;

/// Refusals in a row after which another hypothesis is tested: all gauges that sense the same are
/// right and the prediction is off, or the counts of an encoder have shifted. A load step
/// contradicts the model for a few samples, a fault of a channel for longer.
const PATIENCE: u16 = 25;

/// Variance of an angle that is anywhere in the turn, `pi^2 / 3` [rad^2].
const ANY_ANGLE: f32 = 3.29;

/// The estimator of a gearbox, fixed after start.
#[derive(Clone, Debug)]
pub struct DrivetrainEstimator<'a, const NX: usize> {
    model: GearboxModel<'a>,
    converters: Vec<AdcScaling, MAX_CHANNELS>,
    counters: Vec<EncoderScaling, MAX_ENCODERS>,
    channel_rows: Vec<RowSVector<f32, NX>, MAX_CHANNELS>,
    encoder_rows: Vec<RowSVector<f32, NX>, MAX_ENCODERS>,
    /// The gauges of each direction.
    directions: Vec<Direction, MAX_CHANNELS>,
    /// Whether a channel drives the train, or a zero remembers the load.
    predicting: bool,
    fault_isolation: FaultIsolation,
    /// Channel of the thermometer, temperature at which zeros hold, rate.
    thermometer: Option<(u8, Option<f32>, f32)>,
    transition: Transition<NX, LOADS, RandomWalk>,
    process_noise: ProcessNoise<NX>,
    initial: Gaussian<NX>,
    gate: Gate,
}

/// What changes from sample to sample.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct DrivetrainState<const NX: usize> {
    unwrap: SignalConditioner,
    posterior: Gaussian<NX>,
    gates: [Gate; MAX_SENSORS],
    /// The last reading of each known input.
    known: [f32; MAX_CHANNELS],
    /// Direction in which each friction brakes, -1 to 1.
    braking: [f32; MAX_FRICTIONS],
    /// What the zero of each channel remembers of the load.
    memories: [HysteresisState; MAX_CHANNELS],
    /// Temperature at which the zeros hold, once it is known [K].
    zeroed_at: Option<f32>,
    /// How much warmer it is now, smoothed [K].
    warming: f32,
    age: u16,
    /// Turn of the carrier in the last sample [rad].
    turned: f32,
    homed_by_pulse: bool,
    started: bool,
    /// Consistency of the gauges.
    isolation: Isolation,
    /// How fast the loads move.
    movements: [Movement; LOADS],
    /// Consistency of the encoders.
    tracks: [Track; MAX_ENCODERS],
    /// Whether the next sample is taken by the steady gains.
    steady: bool,
}

impl<'a, const NX: usize> DrivetrainEstimator<'a, NX> {
    /// Checks a model and lays it out for the step.
    ///
    /// # Errors
    /// The name of the first field that is not finite, not positive where it
    /// must be, or of the wrong length for `NX` states.
    pub fn try_build(model: GearboxModel<'a>) -> Result<Self, Error> {
        const { assert!(NX > LOADS && NX <= MAX_STATES, "states of a gearbox") };
        model.check(NX)?;
        let rows = |row: &StateVec<f32>| RowSVector::from_row_slice(row);
        let converters = model
            .channels
            .iter()
            .map(|channel| channel.converter)
            .collect();
        let channel_rows = model
            .channels
            .iter()
            .map(|channel| rows(&channel.row))
            .collect();
        let counters = model
            .encoders
            .iter()
            .map(|encoder| encoder.counter)
            .collect();
        let encoder_rows = model
            .encoders
            .iter()
            .map(|encoder| rows(&encoder.row))
            .collect();
        let errors = (model.channels.iter()).map(|channel| (channel.error(), channel.unit));
        let initial_std = SVector::<f32, NX>::from_row_slice(&model.initial_std);
        Ok(Self {
            transition: Transition::from_rows(&model.transition, RandomWalk)?,
            process_noise: ProcessNoise::try_new(&noise(&model.process_noise, model.load_noise))?,
            initial: Gaussian::independent(
                SVector::from_row_slice(&model.initial_state),
                &initial_std.component_mul(&initial_std),
            )?,
            gate: Gate::try_new(model.gate_nis, u16::MAX)?,
            converters,
            counters,
            channel_rows,
            encoder_rows,
            directions: model.members(),
            predicting: model.has_predicting_channel(),
            fault_isolation: FaultIsolation::new(model.consistency, errors),
            thermometer: model.thermometer(),
            model,
        })
    }

    /// The state before the first sample.
    pub fn start(&self) -> DrivetrainState<NX> {
        DrivetrainState {
            unwrap: SignalConditioner::default(),
            posterior: self.initial,
            gates: [self.gate; MAX_SENSORS],
            known: [0.0; MAX_CHANNELS],
            braking: [0.0; MAX_FRICTIONS],
            memories: [HysteresisState::default(); MAX_CHANNELS],
            zeroed_at: None,
            warming: 0.0,
            age: u16::MAX,
            turned: 0.0,
            homed_by_pulse: false,
            started: false,
            isolation: Isolation::default(),
            tracks: [Track::default(); MAX_ENCODERS],
            movements: [Movement::default(); LOADS],
            steady: false,
        }
    }

    /// One sample: convert, predict, update with each usable reading.
    #[inline(never)]
    pub fn step_into(
        &self,
        state: &mut DrivetrainState<NX>,
        raw: &RawSample,
        estimate: &mut Estimate,
    ) {
        let index = self.model.index.as_ref();
        let lead = self.index_encoder_offset(state);
        let m = (state.unwrap).convert(raw, &self.converters, &self.counters, index, lead);
        if !state.started || m.lost > LONGEST_GAP {
            self.restart(state, &m);
        } else if !m.stale {
            for _ in 0..=m.lost {
                self.predict(state);
            }
        }
        if let Some(by) = m.rehomed {
            rotate(&mut state.posterior, by);
        }
        state.age = state.age.saturating_add(1);
        self.track_temperature(state, &m);

        estimate.begin(m.tick, m.lost);
        if self.model.encoders.is_empty() && raw.index.is_some() && !m.stale {
            self.home_by_pulse(state);
        }
        estimate.homed = m.homed || state.homed_by_pulse || index.is_none();
        estimate.steady = state.steady;
        let steady = self.model.steady.as_ref();
        let variances = match steady.filter(|_| state.steady) {
            Some(gains) => self.update_steady_gain(gains, state, &m, estimate),
            None => self.correct(state, &m, estimate),
        };
        estimate.angle_rad = wrap_rad(state.posterior.state[0]);
        if let Some(gains) = steady {
            self.try_enter_steady(gains, state, &m, estimate);
        }
        let isolation = &state.isolation;
        let deviation = (self.fault_isolation).deviation(isolation, self.directions.len());
        let flags = (estimate.homed, m.slipped);
        for (j, signal) in self.model.loads.iter().enumerate() {
            let load = self.load(state, j, signal, variances, deviation, flags);
            let _ = estimate.loads.push(load);
        }
        // Days without any sensor overflow a variance; what follows is a new start.
        state.started = estimate.loads.iter().all(|load| load.std < f32::MAX)
            && libm::fabsf(state.turned) <= self.model.consistency.most_turn
            && !state.tracks.iter().any(|track| track.lost);
    }

    /// Follows the temperature: as far as it is off at start, then smoothed; where it is
    /// missing, it stays.
    fn track_temperature(&self, state: &mut DrivetrainState<NX>, m: &Measurement) {
        let Some((channel, at_zero, rate)) = self.thermometer else {
            return;
        };
        if let Some(Ok(temperature)) = m.values.get(usize::from(channel)) {
            if let Some(zero) = state.zeroed_at {
                state.warming += rate * (temperature - zero - state.warming);
            } else {
                let zero = at_zero.unwrap_or(*temperature);
                state.zeroed_at = Some(zero);
                state.warming = temperature - zero;
            }
        }
    }

    /// The full recursion: encoders, then channels, one scalar update each.
    fn correct(
        &self,
        state: &mut DrivetrainState<NX>,
        m: &Measurement,
        estimate: &mut Estimate,
    ) -> [f32; LOADS] {
        self.open_sensors(state, m, estimate);
        for k in 0..self.model.encoders.len() {
            let _ = estimate.sensors.push(self.update_angle(state, k, m));
        }
        self.update_gauges(state, m, estimate);
        state.posterior.load_variances::<LOADS>().into()
    }

    fn restart(&self, state: &mut DrivetrainState<NX>, m: &Measurement) {
        state.posterior = self.initial;
        state.gates = [self.gate; MAX_SENSORS];
        state.isolation = Isolation::default();
        state.tracks = state.tracks.map(Track::restarted);
        state.braking = [0.0; MAX_FRICTIONS];
        state.memories = [HysteresisState::default(); MAX_CHANNELS];
        state.age = u16::MAX;
        state.turned = 0.0;
        state.started = true;
        state.steady = false;
        state.movements = [Movement::default(); LOADS];
        if let Some(Ok(angle)) = m.angles.first() {
            state.posterior.state[0] = angle.to_rad();
        }
        if state.tracks[0].is_stuck() {
            // Nothing measures the angle: anywhere in the turn.
            state.posterior.widen(0, ANY_ANGLE);
        }
    }

    /// Takes from `next` what dry frictions brake.
    ///
    /// One sweep of projected Gauss-Seidel from the directions of the sample before: each is solved
    /// beside the others as they are by then.
    fn brake(&self, state: &mut DrivetrainState<NX>, next: &mut SVector<f32, NX>) {
        let mut add = |friction: &Friction, torque: f32| {
            for (x, b) in next.iter_mut().zip(&friction.column) {
                *x += b * torque;
            }
            let speed = next.get(usize::from(friction.speed_state));
            speed.copied().unwrap_or(0.0)
        };
        let of = |friction: &Friction| {
            let at = |i: u8| state.posterior.state.get(usize::from(i)).copied();
            let [speed, carried] = [friction.speed_state, friction.twist_state].map(at);
            friction.size(speed.unwrap_or(0.0), carried.unwrap_or(0.0))
        };
        let frictions = &self.model.frictions;
        let mut torques = [0.0; MAX_FRICTIONS];
        let others = frictions
            .iter()
            .zip(&mut torques)
            .zip(&state.braking)
            .skip(1);
        for ((friction, torque), z) in others {
            *torque = of(friction) * z;
            add(friction, *torque);
        }
        for ((friction, torque), z) in frictions.iter().zip(torques).zip(&mut state.braking) {
            let size = of(friction);
            let free = add(friction, -torque);
            *z = friction.direction(size, free, *z);
            add(friction, size * *z);
        }
    }

    // Inlined into the loop over lost samples, every number of its matrices is loaded before the
    // loop, stored to the stack and loaded again.
    #[inline(never)]
    fn predict(&self, state: &mut DrivetrainState<NX>) {
        let from = state.posterior.state[0];
        let mut next = self.transition.propagate(&state.posterior.state);
        if !self.model.frictions.is_empty() {
            self.brake(state, &mut next);
        }
        state.posterior.state = next;
        state.turned = state.posterior.state[0] - from;
        if !state.steady {
            self.transition
                .propagate_covariance(&mut state.posterior, &self.process_noise);
        }
        if self.model.loads.len() < LOADS {
            // Nothing measures the absent load: what is not known of it must not pile up.
            state
                .posterior
                .reset_variance(NX - 1, self.model.load_noise[LOADS - 1]);
        }
        if self.predicting {
            self.predict_channels(state);
        }
        state.posterior.state[0] = wrap_rad(state.posterior.state[0]);
    }

    /// What drives the train, and what the zeros of gauges remember of the load.
    #[inline(never)]
    fn predict_channels(&self, state: &mut DrivetrainState<NX>) {
        for (i, (channel, row)) in (self.model.channels.iter())
            .zip(&self.channel_rows)
            .enumerate()
        {
            match &channel.role {
                Role::Drive => {
                    let drive = state.known.get(i).copied().unwrap_or(0.0);
                    state.posterior.state += row.transpose() * drive;
                }
                Role::Measure { response, .. } if response.has_state() => {
                    let sensed = dot(row, &state.posterior.state);
                    let variance = observed_variance(row, &state.posterior);
                    if let Some(memory) = state.memories.get_mut(i) {
                        response.advance(memory, sensed, variance);
                    }
                }
                Role::Measure { .. } | Role::Temperature { .. } => {}
            }
        }
    }

    /// How fast load `j` moves beside its random walk: its squared distance from its mean over that
    /// which the walk has; 0 where no error band was measured.
    pub fn load_movement(&self, state: &DrivetrainState<NX>, j: usize) -> f32 {
        state.movements[j % LOADS].peak()
    }

    fn load(
        &self,
        state: &mut DrivetrainState<NX>,
        j: usize,
        signal: &LoadSignal,
        variances: [f32; LOADS],
        (factor, added): (f32, f32),
        (homed, slipped): (bool, bool),
    ) -> LoadEstimate {
        let d = NX - LOADS + j % LOADS;
        let scale = self.model.scale.get(d).copied().unwrap_or(1.0);
        let value = state.posterior.state[d] * scale;
        let (band, q) = (
            &self.model.bands[j % LOADS],
            self.model.load_noise[j % LOADS],
        );
        let movement = state.movements[j % LOADS].follow(state.posterior.state[d], q, band);
        let variance = band.stated_variance(variances[j % LOADS], movement);
        let variance = variance * factor + added;
        let std = trigonometry::sqrt(variance) * scale;
        if !(value.is_finite() && variance >= 0.0 && std.is_finite()) {
            return LoadEstimate {
                value: 0.0,
                std: f32::MAX,
                age: state.age,
                fault: Fault::NotValid,
            };
        }
        let fast = libm::fabsf(state.turned) > self.model.consistency.most_turn;
        let fault = if fast || libm::fabsf(value) > signal.full_scale {
            Fault::Implausible
        } else if std > signal.valid_std {
            Fault::NotValid
        } else if slipped {
            Fault::Slipped
        } else if state.isolation.contradicted() {
            Fault::Contradicted
        } else if !homed {
            Fault::NotHomed
        } else {
            Fault::None
        };
        LoadEstimate {
            value,
            std,
            age: state.age,
            fault,
        }
    }
}

/// `row x`, summed from the first state to the last.
fn dot<const NX: usize>(row: &RowSVector<f32, NX>, x: &SVector<f32, NX>) -> f32 {
    let mut sum = 0.0;
    for i in 0..NX {
        sum += row[i] * x[i];
    }
    sum
}

/// `row P row'`.
#[inline(never)]
fn observed_variance<const NX: usize>(row: &RowSVector<f32, NX>, posterior: &Gaussian<NX>) -> f32 {
    let mut sum = 0.0;
    for j in 0..NX {
        let mut along = 0.0;
        for i in 0..j {
            along += posterior.upper[j][i] * row[i];
        }
        sum += row[j] * (posterior.upper[j][j] * row[j] + 2.0 * along);
    }
    sum
}

/// Result of an update as a sensor's estimate, in the sensor's SI unit.
fn to_sensor_estimate(
    measured: f32,
    update: &Innovation,
    unit: f32,
    refused: Fault,
) -> SensorEstimate {
    SensorEstimate {
        measured: measured * unit,
        innovation: update.value * unit,
        innovation_variance: update.variance * (unit * unit),
        nis: update.nis,
        fault: match update.outcome {
            Outcome::Used => Fault::None,
            Outcome::Gated => refused,
            Outcome::Invalid => Fault::NotValid,
        },
    }
}
