//! Estimates the forces on nodes of a rotor and its modal displacements from displacement sensors,
//! one raw sample at a time (`RotorEstimator::step_into`), by an augmented Kalman filter of a reduced
//! finite-element model at the tracked speed, its matrices over the speed ([`filter`]).
//!
//! The full recursion runs until its gain has converged; then the steady gain of the speed
//! takes its place, until a reading is missing or refused. An estimate may lag by some samples, and
//! is more accurate then ([`fixed_lag_smoother`]). Where the innovations contradict the model,
//! the noise of the model is larger ([`mismatch`]); where the unbalance changes with the speed, the
//! deviations allow for the model's error ([`unbalance_consistency`]); where one sensor contradicts
//! the others, it is held out ([`sensor_exclusion`]).
//!
//! Source: Rezende et al. 2023, section 2.

pub mod filter;
pub mod fixed_lag_smoother;
pub mod mismatch;
mod model;
mod output;
mod scheduled_model;
pub mod sensor_exclusion;
mod shaft_tracker;
pub mod unbalance_consistency;

use heapless::Vec;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::io::estimate::{Estimate, MAX_LOADS, SensorEstimate};
use crate::io::fault::Fault;
use crate::io::measurement::{AdcScaling, EncoderScaling, Measurement, SignalConditioner};
use crate::io::raw::{MAX_CHANNELS, MAX_ENCODERS, RawSample};
use crate::rotor::filter::{
    LoadTransition, ObservationRow, StateEstimate, predict_covariance, predict_measurement,
    predict_state, update,
};
use crate::rotor::fixed_lag_smoother::{FixedLagSmoother, LaggedState, MAX_LAG};
use crate::rotor::mismatch::{Change, Mismatch};
use crate::rotor::scheduled_model::ScheduledModel;
use crate::rotor::sensor_exclusion::SensorExclusion;
use crate::rotor::shaft_tracker::{ShaftTracker, rotation_increment};
use crate::rotor::unbalance_consistency::UnbalanceConsistency;
use crate::signal::phase::Phase;

pub use crate::rotor::model::{
    MAX_LEVELS, MAX_MODES, MAX_STATES, NoiseModel, PackedF32, RotorChannel, RotorModel,
    ShaftEncoder, SpeedGrid, WAVES,
};

/// Samples without any after which a gap is a new start, and without a reading after which
/// the loads are not valid.
const LONGEST_GAP: u32 = 100;

/// Part of the speeds' range beyond its ends that is still estimated.
const MARGIN: f32 = 0.02;

/// The estimator of a rotor, fixed after start.
#[derive(Clone, Debug)]
pub struct RotorEstimator<'a, const NZ: usize, const NX: usize> {
    model: RotorModel<'a>,
    converters: Vec<AdcScaling, MAX_CHANNELS>,
    counters: Vec<EncoderScaling, MAX_ENCODERS>,
    rows: Vec<ObservationRow<f32, NZ>, MAX_CHANNELS>,
    constant: LoadTransition<f32>,
    /// The noise of the description.
    nominal: NoiseModel<'a>,
}

/// What changes from sample to sample.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RotorState<const NZ: usize, const NX: usize> {
    unwrap: SignalConditioner,
    posterior: StateEstimate<f32, NX>,
    smoother: FixedLagSmoother<NX>,
    exclusion: SensorExclusion,
    shaft: ShaftTracker,
    scheduled: ScheduledModel<NZ, NX>,
    mismatch: Mismatch,
    consistency: UnbalanceConsistency,
    /// Standard deviations of the level above, while a lower one is on trial.
    trial_std: [f32; MAX_LOADS],
    /// Samples in a row that used every sensor.
    clean_samples: u32,
    /// Samples in a row that corrected those before them.
    smoothed_samples: u32,
    age: u16,
    started: bool,
}

impl<'a, const NZ: usize, const NX: usize> RotorEstimator<'a, NZ, NX> {
    /// Checks a model and lays it out for the step.
    ///
    /// # Errors
    /// The name of the first field that is not finite, not positive where it
    /// must be, or of the wrong length for `NX` states.
    pub fn try_build(model: RotorModel<'a>) -> Result<Self, Error> {
        const { assert!(NZ <= MAX_MODES && NX <= MAX_STATES, "states of a rotor") };
        model.check(NZ, NX)?;
        let rows = model.channels.iter().map(|channel| {
            let mut modal = [0.0; NZ];
            for (slot, value) in modal.iter_mut().zip(&channel.row) {
                *slot = *value;
            }
            ObservationRow {
                modal,
                bias: channel.bias_state.map(usize::from),
            }
        });
        let nominal = *model.levels.first().ok_or(Error::OutOfRange("levels"))?;
        let (cos_minus_one, sin) = rotation_increment(model.speeds.nominal * model.sample_s, 1.0);
        Ok(Self {
            rows: rows.collect(),
            converters: model.channels.iter().map(|c| c.converter).collect(),
            counters: model.encoder.iter().map(|e| e.counter).collect(),
            constant: LoadTransition {
                synchronous_mask: model.synchronous_mask,
                pairs: model.loads.len() / 2,
                cos_minus_one,
                sin,
                bias_decay: model.bias_decay,
            },
            nominal,
            model,
        })
    }

    /// The state before the first sample, which fills it: empty, it is made where
    /// it stays, and not on the stack.
    #[inline]
    pub fn start(&self) -> RotorState<NZ, NX> {
        RotorState {
            unwrap: SignalConditioner::default(),
            posterior: StateEstimate {
                state: [0.0; NX],
                covariance: [[0.0; NX]; NX],
            },
            smoother: FixedLagSmoother::new(LaggedState::diffuse(self.model.speeds.nominal)),
            exclusion: SensorExclusion::default(),
            shaft: ShaftTracker::new(self.model.speeds.nominal),
            scheduled: ScheduledModel::new(),
            mismatch: Mismatch::default(),
            consistency: UnbalanceConsistency::default(),
            trial_std: [0.0; MAX_LOADS],
            clean_samples: 0,
            smoothed_samples: 0,
            age: u16::MAX,
            started: false,
        }
    }

    /// Samples by which the estimates lag.
    pub fn lag(&self) -> usize {
        usize::from(self.model.lag).min(MAX_LAG)
    }

    /// One sample: convert, predict, update with each usable reading.
    // Inlined, the stack would hold the temporaries of all sizes at once.
    #[inline(never)]
    pub fn step_into(
        &self,
        state: &mut RotorState<NZ, NX>,
        raw: &RawSample,
        estimate: &mut Estimate,
    ) {
        let index = self.model.index.as_ref();
        let m = (state.unwrap).convert(
            raw,
            &self.converters,
            &self.counters,
            index,
            Phase::default(),
        );
        let fresh = !state.started || m.lost > LONGEST_GAP;
        if fresh {
            self.restart(state);
        }
        if let Some(by) = m.rehomed {
            state.shaft.rotate(by);
            let by = by.to_rad();
            state.consistency.rotate(libm::cosf(by), libm::sinf(by));
        }
        let speed = state.shaft.speed;
        let turn = self.track_shaft(state, &m);
        let steady = state.clean_samples >= self.noise(state).full_samples
            && !self.has_missing_measurement(&m);
        if !fresh && !m.stale {
            for _ in 0..=m.lost {
                if self.lag() > 0 {
                    state
                        .smoother
                        .advance()
                        .capture::<NZ>(&state.posterior, speed);
                }
                predict_state(
                    &mut state.posterior.state,
                    &state.scheduled.increment_matrix,
                    &turn,
                );
                if !steady {
                    self.predict_covariance(state, &turn);
                }
            }
        }
        state.age = state.age.saturating_add(1);
        estimate.begin(m.tick, m.lost);
        estimate.angle_rad = state.shaft.angle().to_rad();
        estimate.homed = m.homed || index.is_none();
        let runout_offsets = self.runout_offsets(estimate);
        if !(steady && self.update_steady_gain(state, &m, &runout_offsets, estimate)) {
            if steady {
                self.predict_covariance(state, &turn);
            }
            self.update_full(state, &m, &runout_offsets, estimate);
            state.started = self.is_finite(state);
        }
        self.loads(state, estimate);
        self.compare_unbalances(state, estimate);
        self.monitor_whiteness(state, &m, &estimate.sensors);
        for angle in m.angles.iter().take(self.counters.len()) {
            let _ = estimate.sensors.push(SensorEstimate {
                measured: angle.map_or(0.0, Phase::to_rad),
                fault: angle.err().unwrap_or(Fault::None),
                ..SensorEstimate::default()
            });
        }
    }

    /// Whether the innovations still agree with the noise in use.
    fn monitor_whiteness(
        &self,
        state: &mut RotorState<NZ, NX>,
        m: &Measurement,
        sensors: &[SensorEstimate],
    ) {
        let levels = self.model.levels.len() as u8;
        if m.stale || levels < 2 {
            return;
        }
        if m.lost > 0 {
            state.mismatch.skip();
        }
        let contradicted = state.exclusion.contradicted();
        if self.has_turning_loads_only() && state.mismatch.is_retest_due(contradicted) {
            let restarted = state.mismatch.restarted();
            self.restart(state);
            state.mismatch = restarted;
            return;
        }
        if state.exclusion.admitted() {
            state.mismatch.contradict();
        }
        let place = state.scheduled.place();
        if let Some(change) = state.mismatch.push(sensors, levels, place) {
            self.switch_noise_model(state, change);
        }
    }

    /// The noise that the filter has at present.
    fn noise(&self, state: &RotorState<NZ, NX>) -> &NoiseModel<'a> {
        let level = usize::from(state.mismatch.level());
        self.model.levels.get(level).unwrap_or(&self.nominal)
    }

    /// Another noise from now on. A larger one begins at its steady covariance and gain, and a
    /// smaller one too, but for that of the description, which converges by the full recursion.
    #[cold]
    fn switch_noise_model(&self, state: &mut RotorState<NZ, NX>, change: Change) {
        let level = usize::from(state.mismatch.level());
        let nominal = level == 0;
        if change == Change::Lowered {
            for (j, std) in state.trial_std.iter_mut().enumerate() {
                *std = state.scheduled.load_std[j % MAX_LOADS];
            }
        }
        let from = if nominal { level + 1 } else { level };
        if let Some(noise) = self.model.levels.get(from) {
            noise.covariance.fill(&mut state.posterior.covariance);
        }
        let noise = self.noise(state);
        state.clean_samples = if nominal { 0 } else { noise.full_samples };
        state.smoothed_samples = 0;
        state.exclusion = SensorExclusion::default();
        state.scheduled.reset(&self.model, noise, state.shaft.speed);
    }

    /// Whether every load turns with the shaft: a jump of one reaches all sensors within a turn,
    /// and a fault of half of them is none.
    fn has_turning_loads_only(&self) -> bool {
        let pairs = self.constant.pairs as u32;
        u32::from(self.model.synchronous_mask).trailing_ones() >= pairs
    }

    /// Whether the forces and their variances are numbers.
    fn is_finite(&self, state: &RotorState<NZ, NX>) -> bool {
        let StateEstimate { state, covariance } = &state.posterior;
        (2 * NZ..2 * NZ + self.model.loads.len())
            .all(|d| state[d % NX].is_finite() && covariance[d % NX][d % NX].is_finite())
    }

    /// Whether no reading corrected the state for longer than a gap may be.
    fn silent(state: &RotorState<NZ, NX>) -> bool {
        u32::from(state.age) > LONGEST_GAP
    }

    fn restart(&self, state: &mut RotorState<NZ, NX>) {
        state.posterior.state.fill(0.0);
        (self.model.initial_covariance).fill(&mut state.posterior.covariance);
        state.mismatch = Mismatch::default();
        state.consistency = UnbalanceConsistency::default();
        state.exclusion = SensorExclusion::default();
        state.shaft = ShaftTracker::new(self.model.speeds.nominal);
        state.smoother = FixedLagSmoother::new(LaggedState::diffuse(state.shaft.speed));
        let noise = self.noise(state);
        state.scheduled.reset(&self.model, noise, state.shaft.speed);
        state.clean_samples = 0;
        state.smoothed_samples = 0;
        state.age = u16::MAX;
        state.started = true;
    }

    /// Whether a sensor is missing, or samples are, for which the steady gain was not made.
    fn has_missing_measurement(&self, m: &Measurement) -> bool {
        m.lost > 0 || m.values.iter().take(self.rows.len()).any(Result::is_err)
    }

    /// The shaft one sample on, and the matrices after its speed.
    fn track_shaft(&self, state: &mut RotorState<NZ, NX>, m: &Measurement) -> LoadTransition<f32> {
        // In a sample that comes twice, or late, no time passes.
        if m.stale {
            return self.constant;
        }
        let reading = m.angles.first().and_then(|angle| angle.ok());
        let (dt, samples) = (self.model.sample_s, m.lost.saturating_add(1));
        let encoder = self.model.encoder.as_ref();
        let motion = state
            .shaft
            .advance(dt, samples.min(LONGEST_GAP), reading, encoder);
        if encoder.is_none() {
            return self.constant;
        }
        let noise = self.noise(state);
        state
            .scheduled
            .interpolate_at(&self.model, noise, motion.speed);
        // The turn of one of the samples that were lost.
        let each = motion.turned / samples as f32;
        let (cos_minus_one, sin) = rotation_increment(each, motion.speed_squared_ratio);
        LoadTransition {
            cos_minus_one,
            sin,
            ..self.constant
        }
    }

    /// Reading of each sensor of a shaft on its axis, as it stands; without runout where it is
    /// not known how it stands.
    fn runout_offsets(&self, estimate: &Estimate) -> [f32; MAX_CHANNELS] {
        let channels = &self.model.channels;
        let mut waves = [[0.0; 2]; WAVES];
        if estimate.homed && channels.iter().any(|c| !c.runout.is_empty()) {
            let (cosine, sine) = (
                libm::cosf(estimate.angle_rad),
                libm::sinf(estimate.angle_rad),
            );
            let mut last = [1.0, 0.0];
            for wave in &mut waves {
                last = [
                    last[0] * cosine - last[1] * sine,
                    last[1] * cosine + last[0] * sine,
                ];
                *wave = last;
            }
        }
        let mut runout_offsets = [0.0; MAX_CHANNELS];
        for (zero, channel) in runout_offsets.iter_mut().zip(channels) {
            *zero = channel.zero(&waves);
        }
        runout_offsets
    }

    /// Where no reading confirms the smaller noise, the larger one.
    fn predict_covariance(&self, state: &mut RotorState<NZ, NX>, turn: &LoadTransition<f32>) {
        let largest = self.model.levels.last().filter(|_| Self::silent(state));
        let noise = &largest.unwrap_or_else(|| self.noise(state)).process;
        let p = &mut state.posterior.covariance;
        predict_covariance(p, &state.scheduled.increment_matrix, turn, |i| noise.get(i));
    }

    /// Every channel by the steady gain; false where one is outside of its gate,
    /// and the state as predicted.
    fn update_steady_gain(
        &self,
        state: &mut RotorState<NZ, NX>,
        m: &Measurement,
        runout_offsets: &[f32; MAX_CHANNELS],
        estimate: &mut Estimate,
    ) -> bool {
        let mut innovations = [0.0; MAX_CHANNELS];
        let sensors = (self.rows.iter().zip(runout_offsets)).zip(&state.scheduled.variance);
        for (((row, zero), variance), (slot, value)) in
            sensors.zip(innovations.iter_mut().zip(&m.values))
        {
            let Ok(value) = value else {
                return false;
            };
            let nu = value - zero - predict_measurement(&state.posterior.state, row);
            let within = nu * nu <= self.model.gate_nis * variance;
            if !within {
                return false;
            }
            *slot = nu;
        }
        let [newest, before @ ..] = &state.scheduled.gains;
        let before = before.get(..self.lag()).unwrap_or_default();
        let innovations = innovations.get(..self.rows.len()).unwrap_or_default();
        state.smoother.update(before, innovations);
        let gains = newest.iter().zip(&state.scheduled.variance);
        for (((gain, variance), nu), (channel, value)) in
            (gains.zip(innovations)).zip(self.model.channels.iter().zip(&m.values))
        {
            for j in 0..NX {
                state.posterior.state[j] += gain[j] * nu;
            }
            let sensor = SensorEstimate {
                measured: value.unwrap_or(0.0) * channel.unit,
                innovation: nu * channel.unit,
                innovation_variance: variance * (channel.unit * channel.unit),
                nis: nu * nu / variance,
                fault: Fault::None,
            };
            let _ = estimate.sensors.push(sensor);
        }
        estimate.steady = true;
        state.smoothed_samples = state.smoothed_samples.saturating_add(1);
        state.age = 0;
        true
    }

    /// Each channel by the full recursion.
    fn update_full(
        &self,
        state: &mut RotorState<NZ, NX>,
        m: &Measurement,
        runout_offsets: &[f32; MAX_CHANNELS],
        estimate: &mut Estimate,
    ) {
        let sensors = self.rows.len();
        let established = self.has_turning_loads_only() && state.mismatch.is_established();
        state.exclusion.begin(sensors, established);
        if !m.stale {
            state.smoothed_samples = 0;
        }
        // The steady gain is not that of a gap.
        let mut all = m.lost == 0;
        for (i, (row, channel)) in self.rows.iter().zip(&self.model.channels).enumerate() {
            let value = match m.values.get(i) {
                Some(Ok(value)) => *value,
                Some(Err(fault)) => {
                    all = false;
                    let _ = estimate.sensors.push(SensorEstimate {
                        fault: *fault,
                        ..SensorEstimate::default()
                    });
                    continue;
                }
                None => continue,
            };
            let exclusion = &mut state.exclusion;
            let (result, used) = update(
                &mut state.posterior,
                row,
                value - runout_offsets[i % MAX_CHANNELS],
                channel.variance,
                |nis| exclusion.accepts(i, nis <= self.model.gate_nis),
            );
            if used {
                state.age = 0;
            }
            all &= used;
            let finite = |x: f32| if x.is_finite() { x } else { 0.0 };
            let _ = estimate.sensors.push(SensorEstimate {
                measured: value * channel.unit,
                innovation: finite(result.innovation) * channel.unit,
                innovation_variance: finite(result.variance) * (channel.unit * channel.unit),
                nis: finite(result.nis),
                fault: if used {
                    Fault::None
                } else if result.nis.is_finite() {
                    Fault::Erratic
                } else {
                    Fault::NotValid
                },
            });
        }
        state.clean_samples = match all {
            _ if m.stale => state.clean_samples,
            true => state.clean_samples.saturating_add(1),
            false => 0,
        };
    }
}
